"""The Sliced Pineapple Grid Feature (paper, section 3.1): what the surface looks like around a texlet.

The neighbours within r are described by three angles each (`ops.pairwise_relations`), ordered into two rings of cells
around the centre's normal, one for surface that faces as the centre does and one for surface that faces away
(`ops.ring_grid`), smoothed by a weighted moving average, and what is still empty is encoded as a gap
(`ops.moving_average`). The rings start at the direction of highest curvature, to which the centre's pose is turned
(`ops.alignment`). `spgf` asks for it all.

Other descriptors take its place where the settings say so (`descriptors`), through one `interface`: histograms of
point features (`fpfh`) and pairs of patches (`patch_pairs`), baselines to compare with.
"""
