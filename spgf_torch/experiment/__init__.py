"""The paper's experiment: objects are described once, then learned from and predicted on in folds (section 4).

`describe` turns an object and its trials into what the learner sees; `cross_validation` runs the folds.
"""
