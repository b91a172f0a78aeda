"""Small hands made in tests: boxes on a palm (m, kg), joints and limits as the test says."""

from __future__ import annotations

from pathlib import Path

from spgf_torch.hands.config import HandConfig
from spgf_torch.settings import typed

INERTIA = '<inertial><mass value="0.05"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>'


def link(name: str, size: str = "", at: str = "0 0 0") -> str:
    box = f'<collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></collision>' if size else ""
    return f'<link name="{name}">{INERTIA}{box}</link>'


def joint(
    name: str, child: str, kind: str = "prismatic", parent: str = "palm", at: str = "0 0 0.05", **more: str
) -> str:
    """`axis`, `limit` ("lower upper"), `mimic` ("joint multiplier offset"), `effort`, `velocity`."""
    low, high = more.get("limit", "0 0.05").split()
    most = f'effort="{more.get("effort", "0")}" velocity="{more.get("velocity", "0")}"'
    limit = f'<limit lower="{low}" upper="{high}" {most}/>'
    mimic = ""
    if "mimic" in more:
        of, ratio, offset = more["mimic"].split()
        mimic = f'<mimic joint="{of}" multiplier="{ratio}" offset="{offset}"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        f'<axis xyz="{more.get("axis", "1 0 0")}"/>{limit}{mimic}</joint>'
    )


def robot(*parts: str) -> str:
    return f'<robot name="clamp">{link("palm", "0.2 0.04 0.04")}{"".join(parts)}</robot>'


def clamp(left: str = "-1 0 0", right: str = "1 0 0", limits: tuple[str, str] = ("0 0.05", "0 0.05")) -> str:
    """A jaw along x: faces at x = -+value, 20 mm wide along y, from 40 to 70 mm along z."""
    return robot(
        link("left", "0.01 0.02 0.06", "-0.005 0 0.02"),
        link("right", "0.01 0.02 0.06", "0.005 0 0.02"),
        joint("left_joint", "left", axis=left, limit=limits[0], effort="40", velocity="0.1"),
        joint("right_joint", "right", axis=right, limit=limits[1], effort="40", velocity="0.1"),
    )


def described(folder: Path, urdf: str, **keys: object) -> HandConfig:
    """A description of the URDF, written to the folder; by default a jaw of the fingers left and right, 60 mm open."""
    path = folder / "clamp.urdf"
    path.write_text(urdf)
    told = {
        "name": "clamp",
        "urdf": str(path),
        "fingers": {"left": ["left"], "right": ["right"]},
        "preshapes": {"wide": {"opening": 0.06}},
        **keys,
    }
    return typed(HandConfig, told)
