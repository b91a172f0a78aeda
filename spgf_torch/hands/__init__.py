"""Hands: joints, pads and shapes from a URDF (`hand`), and grasps and grippers as records (`records`).

Frames, everywhere `p_a = T_a_b @ p_b`, metres, radians, quaternions named w and xyz:
- input: the frame of the points that were given. A format that speaks of a camera or of an object means this frame.
- tcp: midway between the pads, +z approach, +x closing. The same directions for every hand.
- base: the hand's base link with the axes that its URDF gives it, which is what a robot's model knows by that name.
  Only where a format knows a gripper but no URDF, its axes are the tcp's (+z approach, +x closing), renamed as the
  format wants them.
"""
