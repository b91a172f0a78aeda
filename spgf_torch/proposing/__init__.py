"""New grasp poses without a mesh: feature pose x learned particle (beyond the paper, which ranks sampled candidates).

`grasp_seeds` keeps each prototype's promising particles; `sampling` picks features and merges poses by distance;
`clearance` tests what the open hand would touch; `propose` goes from texlets to ranked grasps.

The other way, with a judge: `hand_geometry` is what the hand's shapes say of where it closes, `hypotheses` pushes it
onto what is seen, `judge_features` describes each, `judge` (`tree_ensembles`) says how likely it holds,
`judge_proposer` ranks. `antipodal` ranks the same hypotheses without learning. `push_loops` and `hand_loops` are the
compiled loops of `hypotheses` and `judge_features`.
"""
