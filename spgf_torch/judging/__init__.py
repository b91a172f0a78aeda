"""Learning a judge of grasp hypotheses (`proposing.judge`; beyond the paper): from random trials, then its own choice.

`clouds` senses each object alone and on a table, from one side and from several; `training_rows` describes trials in
these clouds; `rounds` chooses hypotheses and has them tried (`resumable_trials`); `learning` fits; `validation`
measures on held-out objects; `card` tells people. `candidates` is the ranking `judge` of the paper's experiment.
"""
