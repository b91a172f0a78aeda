"""Grasp trials in physics: hand, candidates, pre-check, episode, runner, trial table (paper, section 4).

`episode` is the only importer of SAPIEN; `table` and `hand` are read without it.
"""
