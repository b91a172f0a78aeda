"""Trial tables as data sets for other people's programs: ACRONYM, GraspGen, WebDataset, Isaac, graspnetAPI.

`source` brings objects, trials, folds and sensed clouds together; a module a format writes them and reads them back
(`samples`: ready training samples; `shards`: GraspGen's WebDataset); `common` holds what stands beside the grasps,
`card` says what is in the folder, `folder` puts it in place at once or not at all. The content of each format is that
of design/EXPORTS.md; the paper has no part in this.

Frames. Poses are of the *gripper*, in the frame of the object's mesh (scaled, not recentred): +z approach, +x closing,
origin at the hand's base. These are the axes of tcp at the origin of the base link (`source.gripper_frame`).
Only graspnetAPI has axes of its own.
"""
