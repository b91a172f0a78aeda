"""Rigid transforms and neighbour search, and the conventions that every module keeps.

Units. Metres, kilograms, seconds, radians. Degrees appear only in settings (names ending in `_deg`) and in
text for people. Tensors are float32 in storage; reference code in the tests runs in float64.

Rotations. Quaternions are wxyz with w >= 0.

Poses. 4x4 matrices on column vectors: `p_a = T_a_b @ p_b`, and `T_a_c = T_a_b @ T_b_c`. The name carries the
frames. Leading batch dimensions are free.

Frames.
- object: the frame of the object's mesh; texlets, features and grasps are all given in it. A scene read from
  a file or sensed in the world takes the place of the object frame.
- texlet (paper Eq. 1): position and unit normal, the normal on the side of the camera that saw it.
- feature (`T_object_feature`): origin at the centre texlet, z its normal, x the aligned direction of section
  3.1.2, y = z cross x. The in-plane angle alpha3 is counted from x towards y.
- tcp (`T_object_tcp`): origin between the finger pads, +z approach (out of the palm), +x closing. Exports
  speak of the gripper's base; the fixed transform base-TCP belongs to the hand.
- particle (section 3.4): `T_feature_tcp = inverse(T_object_feature) @ T_object_tcp`.

Feature angles (section 3.1.1). With d = X1 - X2 from the neighbour to the centre: alpha1 in [-pi/2, pi/2] is
positive where the surface falls away below the centre's plane, alpha2 in [0, pi] is the angle between the
normals. Ring cell 0 is the aligned direction; cell k is centred on alpha3 = k * 2 pi / N_g.

Randomness. A generator is passed down and never global; `if seed is not None`, so that seed 0 counts.
"""
