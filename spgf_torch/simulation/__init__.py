"""Grasp trials in physics: candidates, pre-check, episode, execution, trial table (paper, section 4).

`episode` is the only importer of SAPIEN; `table` is read without it. `generation` makes a table over as many calls as
it takes: `run_state` keeps what is done, `executors` run chunks of trials by `worker`, each in a `worker_process`.
"""
