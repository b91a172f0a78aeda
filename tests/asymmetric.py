"""One asymmetric grasp worked out by hand, for every format (m, rad). c = cos 30 deg = 0.8660254, s = sin 30 deg = 0.5.

The TCP. R is 90 deg about z, then 30 deg about the new x:
    Rz = [0 -1 0; 1 0 0; 0 0 1],  Rx = [1 0 0; 0 c -s; 0 s c],  R = Rz Rx = [0 -c s; 1 0 0; 0 s c]
so closing (first column) points along +y of the input, approach (third) along (0.5, 0, 0.8660254). t = (0.1, 0.2, 0.3).
As a quaternion (w; x, y, z), with C = cos 15 deg = 0.9659258, S = sin 15 deg = 0.2588190, h = 0.7071068:
    (h; 0, 0, h) (C; S, 0, 0) = (hC; hS, hS, hC) = (0.6830127; 0.1830127, 0.1830127, 0.6830127)

The hand. Its base stands 200 mm behind the TCP and 20 mm beside it, and closes along its own y, as the SDH-2 does:
    T_base_tcp = [0 -1 0 0.02; 1 0 0 0; 0 0 1 0.2]
The base. Its rotation is R Rz^-1, Rz^-1 = [0 1 0; -1 0 0; 0 0 1]:
    R Rz^-1 = [c 0 s; 0 1 0; -s 0 c]  (30 deg about y), quaternion (C; 0, S, 0) = (0.9659258; 0, 0.2588190, 0)
Its origin is t - (R Rz^-1) (0.02, 0, 0.2):
    (c 0.02 + s 0.2, 0, -s 0.02 + c 0.2) = (0.1173205, 0, 0.1632051)
    (0.1 - 0.1173205, 0.2 - 0, 0.3 - 0.1632051) = (-0.0173205, 0.2, 0.1367949)

Waiting 60 mm back: t - 0.06 (0.5, 0, 0.8660254) = (0.07, 0.2, 0.2480385).
"""

import numpy as np
import trimesh

from spgf_torch.hands.records import Grasp, Gripper, make_grasp

T_INPUT_TCP = np.array([[0, -0.8660254, 0.5, 0.1], [1, 0, 0, 0.2], [0, 0.5, 0.8660254, 0.3], [0, 0, 0, 1]])
T_INPUT_BASE = np.array(
    [[0.8660254, 0, 0.5, -0.0173205], [0, 1, 0, 0.2], [-0.5, 0, 0.8660254, 0.1367949], [0, 0, 0, 1]]
)
WAITING = np.array([0.07, 0.2, 0.2480385])
BASE_W, BASE_XYZ = 0.9659258, [0, 0.2588190, 0]
T_BASE_TCP = np.array([[0, -1, 0, 0.02], [1, 0, 0, 0], [0, 0, 1, 0.2], [0, 0, 0, 1.0]])
EXACT = 1e-6  # the numbers above have seven digits


def gripper(kind: str = "WPG") -> Gripper:
    """A hand of two driven fingers, a held thumb and a mimic joint; 80 mm open (WPG) or 40 mm (NPG)."""
    width = {"NPG": 0.04, "WPG": 0.08}[kind]
    opened = {"left": width / 2, "right": width / 2, "thumb": -1.5, "shadow": 0.1}
    finger = trimesh.creation.box((0.01, 0.02, 0.05))
    sides = [finger.copy().apply_translation([side * (width / 2 + 0.005), 0, -0.01]) for side in (-1, 1)]
    return Gripper(
        name=f"claw_{kind}",
        type=kind,
        base_link="palm",
        T_base_tcp=T_BASE_TCP,
        joints=opened,
        closed={**opened, "left": 0.0, "right": 0.0},
        active=("left", "right", "thumb"),
        width=width,
        depth=0.015,
        height=0.02,
        jaw=True,
        symmetry=2,
        shapes=tuple(sides),
    )


GRIPPERS = {kind: gripper(kind) for kind in ("NPG", "WPG")}


def exact_pose() -> np.ndarray:
    """T_input_tcp with all digits of c and s."""
    c, s = np.sqrt(3) / 2, 0.5
    return np.array([[0, -c, s, 0.1], [1, 0, 0, 0.2], [0, s, c, 0.3], [0, 0, 0, 1]])


def asymmetric(kind: str = "WPG", probability: float = 0.875) -> Grasp:
    return make_grasp(GRIPPERS[kind], exact_pose(), probability, 42, [(3, 12), (7, 30)], retreat=0.06)
