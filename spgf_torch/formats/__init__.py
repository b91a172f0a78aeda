"""Formats of other programs, each with a reader written from its specification.

Predicted grasps: `grasps_json`, `isaac`, `graspnet`. These formats know one gripper, so a hand is one gripper for each
grasp type: `sdh2_NPG`, `sdh2_WPG`. Frames: `spgf_torch.hands`.

Trial tables as data sets: `acronym`, `graspgen`, `isaac`, `graspnet`, and WebDataset (`samples`:
ready training samples; `shards`: GraspGen's; `tar`). `trial_sets` holds objects, trials, folds and sensed
clouds together, `read_trials` reads them; `common` writes what all formats share, `card` describes the folder, `folder`
puts it in place atomically, `write_datasets` does all of it. The paper has no part in this.

In data sets, poses are of the *gripper*, in the frame of the object's mesh (scaled, not recentred): +z approach, +x
closing, origin at the hand's base. These are the axes of tcp at the origin of the base link
(`trial_sets.gripper_frame`). Only graspnetAPI has axes of its own.
"""
