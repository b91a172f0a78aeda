"""Grasp affordances (paper, section 3.4): shape-grasp particles, their neighbourhood analysis and the votes.

`pairs` and `particles` tie features to grasps, in cells of SE(3) (`geometry.se3_grid`); `neighbourhood` gives
populated cells their probability and support and condenses them; `voting` lets a novel object's features vote
on its candidate grasps; `ranking` orders the candidates, `calibration` gives them probabilities; `model` is
what `train` saves and `evaluate` loads. The arithmetic of pairs, analysis and votes is in `spgf_torch.ops`.
"""
