"""From objects and trials to a model in a folder: what the command `train` and `spgf_torch.train` share.

The paper's experiment (section 4) is part of it where there are objects enough for a cross-validation.
"""
