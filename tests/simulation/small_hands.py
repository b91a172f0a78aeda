"""Small hands made in tests: boxes on a palm (m, kg), joints and limits as the test says."""

from __future__ import annotations

from pathlib import Path

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.settings import typed

FINGER = ("0.01 0.03 0.06", "0 0 0.03")  # size, and where its middle is


def link(name: str, size: str = "", at: str = "0 0 0", mass: float = 0.1) -> str:
    box = f'<collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></collision>' if size else ""
    inertia = '<inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>'
    return f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/>{inertia}</inertial>{box}</link>'


def joint(name: str, child: str, kind: str = "prismatic", parent: str = "palm", at: str = "0 0 0", **more: str) -> str:
    """`axis`, `limit` ("lower upper"), `mimic` ("joint multiplier offset")."""
    low, high = more.get("limit", "0 0.05").split()
    mimic = ""
    if "mimic" in more:
        of, ratio, offset = more["mimic"].split()
        mimic = f'<mimic joint="{of}" multiplier="{ratio}" offset="{offset}"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        f'<axis xyz="{more.get("axis", "1 0 0")}"/><limit lower="{low}" upper="{high}" effort="60" velocity="1"/>'
        f"{mimic}</joint>"
    )


def robot(*parts: str) -> str:
    return f'<robot name="small">{link("palm", "0.16 0.06 0.02", "0 0 -0.01")}{"".join(parts)}</robot>'


def described(folder: Path, urdf: str, **keys: object) -> Hand:
    """The hand of this URDF: a jaw of left and right, whose pads are the middles of their faces, unless told else."""
    path = folder / "small.urdf"
    path.write_text(urdf)
    told = {
        "name": "small",
        "urdf": str(path),
        "fingers": {"left": ["left"], "right": ["right"]},
        "closing": {"effort": 20, "speed": 0.1, "time": 1.5},
        **keys,
    }
    return load_hand(typed(HandConfig, told))


def jaw_preshape(**keys: object) -> dict:
    """Both joints of `jaw` close from 60 mm."""
    return {"open": {"left_joint": 0.03, "right_joint": 0.03}, "close": {"left_joint": -1, "right_joint": -1}, **keys}


def jaw(*more: str, left: str = "left", right: str = "right") -> str:
    """Faces at x = -+value, 30 mm wide along y, 60 mm high from the palm."""
    size, _ = FINGER
    return robot(
        link("left", size, "-0.005 0 0.03"),
        link("right", size, "0.005 0 0.03"),
        joint("left_joint", left, axis="-1 0 0"),
        joint("right_joint", right, axis="1 0 0"),
        *more,
    )
