"""Torch operators: each heavy step of the method as one operation of torch, on any device.

One module an operator (`library.Operator`): its schema, an implementation by torch's own operations that runs wherever
the tensors are, loops compiled for the CPU, and what `torch.compile` must know of its outputs. Callers ask for the
operator and never for a device. Both implementations compute in the same precision and in the same order, so that a
pose falls into the same cell in either. With `SPGF_OPS=torch` in the environment nothing compiled runs; one prediction
where nothing is kept compiled does the same by itself (`compiled.spare_loops`).

    describe                texlets -> pose and rings of the feature at each; its steps:
        neighbours            points -> pairs of neighbours
        relations             pairs -> frames and angles
        ring_grid             angles -> two rings of cells
        moving_average        cells -> smoothed rings, gaps encoded
        alignment             rings -> where they start
    assignment              features and prototypes -> the nearest prototype
    kmeans, lloyd           features and prototypes -> sums of members; steps that move prototypes
    kmeans_start            the search for the first prototypes: k-means++, weighted steps
    partition               points -> parts that are alike
    relative_cells          features and grasps -> the cells of one relative to the other
        cell_pairs            the pairs within reach and their cells, listed
    neighbourhood_analysis  shape-grasp particles -> weighted counts of success around cells
        neighbourhood_loops   its loops over particles
    outcome_counts          shape-grasp particles -> successes and particles of each prototype and grasp type
    look_up                 cells -> points of a condensed shape-grasp space
    accumulate_votes        features and grasps -> how many votes each grasp gets, and their gain
    points_in_volume        points and hands -> whether a hand holds a point
    deepest_free            hands pushed through points -> where they are free
        push_loops            its loops
    extents                 points about hands -> how far those between planes reach
    nearest_piece           points about hands -> how near they are to the hand
    pad_numbers             points about hands -> numbers of those between the pads
    facing_gap              points between fingers -> the widest gap of surfaces that face each other
    depth_behind            bodies at poses and a depth image -> how far behind its surface
    leaves                  numbers and decision trees -> values of leaves
    farthest_first          points -> a few that are spread over all

Tensors are in the units and frames of `spgf_torch.geometry`. No operator has a derivative: to ask for one is
an error.
"""
