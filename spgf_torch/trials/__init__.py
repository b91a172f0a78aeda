"""Grasp trials in physics: hand, candidates, pre-check, episode, runner, trial table (paper, section 4).

`episode` is the only importer of SAPIEN; `table` and `hand` are read without it. A `campaign` makes a table over as
many calls as it takes: `journal` keeps what is done, `runners` say where, `attempts` what is done, in a `cell` each.
"""
