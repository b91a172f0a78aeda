"""New grasp poses without a mesh: feature pose x learned particle (beyond the paper, which ranks sampled candidates).

`shortlist` keeps each prototype's promising particles; `spreading` picks features and merges poses by distance;
`clearance` asks what the open hand would touch; `propose` goes from texlets to ranked grasps.
"""
