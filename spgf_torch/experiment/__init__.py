"""The paper's experiment: objects are described once, then learned from and predicted on in folds (section 4).

`describe` turns an object and its trials into a `DescribedObject`; `training_space` is what training objects say of
grasps; `cross_validation` predicts on a fold and chooses among the rankings inside the others; `experiment` runs
all folds and learns the model of all objects.
"""
