"""Formats of other people's programs, each with a reader written from its specification.

Grasps that were predicted: `grasps_json`, `isaac`, `graspnet`. They know one gripper, so they see a hand as one gripper
for each grasp type: `sdh2_NPG`, `sdh2_WPG`. Frames: `spgf_torch.hands`.

Trial tables as data sets: `acronym`, `graspgen`, `isaac_datasets`, `graspnet_datasets`, and WebDataset (`samples`:
ready training samples; `shards`: GraspGen's; `tar`). `trial_sets` brings objects, trials, folds and sensed
clouds together; `common` holds what stands beside the grasps, `card` says what is in the folder, `folder` puts it in place at once or
not at all, `write_datasets` does all of it. The paper has no part in this.

There, poses are of the *gripper*, in the frame of the object's mesh (scaled, not recentred): +z approach, +x closing,
origin at the hand's base. These are the axes of tcp at the origin of the base link (`trial_sets.gripper_frame`).
Only graspnetAPI has axes of its own.
"""
