"""The same grasp trials in MuJoCo: what holds in both engines does not hang on how one of them makes contacts.

`model` makes hand and object a MuJoCo model, from the records that SAPIEN's articulation is made from; `trial` is the
episode of `simulation.episode` in it, with the same fingers, loads and tests of the outcome.
"""
