"""The two shipped hands with one thing wrong in each: URDF and description are changed, and read as a user's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import trimesh
import yaml
from commands import ROOT

from spgf_torch.errors import InputError
from spgf_torch.handcheck.check import check_hand
from spgf_torch.handcheck.finding import failed
from spgf_torch.hands.description_file import read_description
from spgf_torch.hands.hand import Hand, load_hand

Change = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Wrong:
    """One mistake.

    Attributes:
        kind: what kind of mistake. hand: panda or sdh2. told: the check, or a part of the error, that tells it.
        urdf: texts of the URDF, and what takes their place. change: of the description.
    """

    kind: str
    hand: str
    told: str
    urdf: tuple[tuple[str, str], ...] = ()
    change: Change | None = None


def write(folder: Path, wrong: Wrong) -> Path:
    """The description, with its URDF and two meshes beside it: a palm in mm, a finger of 0.02 mm."""
    xml = (ROOT / f"data/hands/{wrong.hand}.urdf").read_text()
    for old, new in wrong.urdf:
        assert old in xml, old
        xml = xml.replace(old, new)
    (folder / "hand.urdf").write_text(xml)
    trimesh.creation.box((63, 208, 92)).export(folder / "palm.stl")
    trimesh.creation.box((2e-5, 2e-5, 2e-5)).export(folder / "speck.stl")
    values = yaml.safe_load((ROOT / f"conf/hand/{wrong.hand}.yaml").read_text())
    values["urdf"] = "hand.urdf"
    if wrong.change is not None:
        wrong.change(values)
    (folder / "hand.yaml").write_text(yaml.safe_dump(values))
    return folder / "hand.yaml"


def load(folder: Path, wrong: Wrong) -> Hand:
    return load_hand(read_description(write(folder, wrong)))


def told(folder: Path, wrong: Wrong) -> list[str]:
    """What is said of a hand before anything is simulated: the error, or every check that fails."""
    try:
        return [finding.line() for finding in failed(check_hand(load(folder, wrong)))]
    except InputError as error:
        return [str(error)]


def each(key: str, value: Any) -> Change:
    """Set a key of every preshape."""

    def change(values: dict[str, Any]) -> None:
        for preshape in values["preshapes"].values():
            preshape[key] = value

    return change


def top(key: str, value: Any) -> Change:
    """Set a key of the description."""
    return lambda values: values.__setitem__(key, value)


def three_fingers(close: float) -> Change:
    """The SDH-2's two fingers against its thumb, all as strong as each other or the fingers with share `close`."""

    def change(values: dict[str, Any]) -> None:
        values["fingers"] = {"first": ["finger_1_tip"], "second": ["finger_2_tip"], "thumb": ["thumb_tip"]}
        joints = [f"{finger}_proximal_joint" for finger in ("finger_1", "finger_2", "thumb")]
        values["preshapes"] = {
            "cylinder": {
                "open": dict.fromkeys(joints, -30),
                "close": dict(zip(joints, (close, close, 1), strict=True)),
                "oppose": [["first", "second"], ["thumb"]],
                "pads": {finger: [0.0148, 0, 0.040] for finger in ("first", "second", "thumb")},
            }
        }

    return change


PADS = {"left": [0, 0, 0.045], "right": [0, 0, 0.045]}
SDH_PADS = {"first": [0.0148, 0, 0.040], "second": [0.0148, 0, 0.040]}
MIMIC = '<mimic joint="panda_finger_joint1"/>'
DRIVEN = each("close", {"panda_finger_joint1": -1})
PALM_BOX, TIP_BOX = '<box size="0.063 0.208 0.092"/>', '<box size="0.0175 0.0142 0.0176"/>'
PANDA_LIMIT = '<limit lower="0" upper="0.04"'
# Ten degrees for the distal joint of finger 1, which must turn by twenty to keep its pad parallel.
TO_TIP = """<child link="finger_1_tip"/>
    <origin xyz="0 0 0.0865" rpy="0 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1.5707963267948966" upper="1.5707963267948966\""""
DISTAL = ((TO_TIP, TO_TIP.replace("1.5707963267948966", "0.17")),)
KG_MM2 = (("4.244e-05", "42.44"), ("4.321e-05", "43.21"), ("9.703e-06", "9.703"))  # inertias of the tips
FLAT_THUMB = {"thumb_proximal_joint": -90, "thumb_distal_joint": -90}  # and knuckles that face one way
MISNAMED = {"left": ["panda_left_finger"], "right": ["panda_rightfinger"]}
PROXIMAL = {"first": ["finger_1_proximal"], "second": ["finger_2_tip"]}
STRONG = {"effort": 1e4, "stiffness": 25000, "damping": 200}


def in_groups(values: dict[str, Any]) -> None:
    """A finger on the thumb's side."""
    three_fingers(0.5)(values)
    values["preshapes"]["cylinder"]["oppose"] = [["first", "thumb"], ["second"]]


def turned(values: dict[str, Any]) -> None:
    """A thumb against two fingers, half a turn of which is another hand."""
    three_fingers(0.5)(values)
    values["preshapes"]["cylinder"]["symmetry"] = 2


def vice(values: dict[str, Any]) -> None:
    values.update(joints=dict.fromkeys(values["joints"], STRONG), closing={"effort": 5000, "speed": 0.05, "time": 0.9})


def closing(effort: float, time: float) -> Change:
    return top("closing", {"effort": effort, "speed": 0.05, "time": time})


CASES = [
    Wrong(
        "signs",
        "panda",
        "WPG.opening: expected 0.040 to",
        change=each("close", {"panda_finger_joint1": -1, "panda_finger_joint2": 1}),
    ),
    Wrong("signs", "panda", "joints close", change=each("close", {"panda_finger_joint1": 1, "panda_finger_joint2": 1})),
    Wrong(
        "signs",
        "sdh2",
        "NPG.opening: expected 0.036 to",
        change=each("close", {"finger_1_proximal_joint": -1, "finger_2_proximal_joint": 1}),
    ),
    Wrong(
        "signs",
        "sdh2",
        "pads stay parallel",
        change=each(
            "parallel",
            {f"finger_{i}_distal_joint": {"of": f"finger_{i}_proximal_joint", "ratio": 1} for i in (1, 2)},
        ),
    ),
    Wrong("axes", "panda", "expected pads that move apart", urdf=(('<axis xyz="0 -1 0"/>', '<axis xyz="0 1 0"/>'),)),
    Wrong("axes", "panda", "TCP ahead of the palm", change=top("approach", [0, 0, -1])),
    Wrong("axes", "panda", "approach", change=top("approach", [0, 1, 0])),
    Wrong(
        "axes",
        "sdh2",
        "NPG.opening: expected 0.066 to",
        change=each("hold", FLAT_THUMB),
    ),
    Wrong("pads", "panda", "pad on its link", change=each("pads", {**PADS, "left": [0, 0.004, 0.045]})),
    Wrong("pads", "panda", "pads level", change=each("pads", {**PADS, "left": [0, 0, 0.0371]})),
    Wrong("pads", "sdh2", "pads face", change=each("pads", {**SDH_PADS, "first": [-0.013, 0, 0.040]})),
    Wrong(
        "pads",
        "sdh2",
        "pads level",
        change=top("fingers", PROXIMAL),
    ),
    Wrong("pads", "panda", "TCP", change=each("tcp", {"xyz": [0, 0, 0.03]})),
    Wrong("limits", "sdh2", "limits of WPG", urdf=DISTAL),
    Wrong(
        "limits",
        "panda",
        "hand.preshapes.WPG.opening: expected",
        urdf=((PANDA_LIMIT, '<limit lower="0" upper="0.02"'),),
    ),
    Wrong("limits", "panda", "fingers meet of NPG", urdf=((PANDA_LIMIT, '<limit lower="0.015" upper="0.04"'),)),
    Wrong("limits", "panda", "closing in time", change=closing(50, 0.5)),
    Wrong("inertia", "panda", "mass of links", urdf=(('<mass value="0.015"/>', '<mass value="15"/>'),)),
    Wrong(
        "inertia",
        "sdh2",
        "inertia of links",
        urdf=(
            ('ixx="4.244e-05"', 'ixx="42.44"'),
            ('iyy="4.321e-05"', 'iyy="43.21"'),
            ('izz="9.703e-06"', 'izz="9.703"'),
        ),
    ),
    Wrong(
        "mimics", "panda", "expected pads that move", urdf=((MIMIC, MIMIC[:-2] + ' multiplier="-1"/>'),), change=DRIVEN
    ),
    Wrong("mimics", "panda", "limits", urdf=((MIMIC, MIMIC[:-2] + ' offset="0.02"/>'),), change=DRIVEN),
    Wrong("mimics", "panda", "panda_finger_joint3", urdf=((MIMIC, MIMIC.replace("joint1", "joint3")),)),
    Wrong("meshes", "panda", "a mesh of at most 2 m", urdf=((PALM_BOX, '<mesh filename="palm.stl"/>'),)),
    Wrong("meshes", "panda", "size", urdf=((PALM_BOX, '<mesh filename="palm.stl" scale="0.007 0.007 0.007"/>'),)),
    Wrong("meshes", "panda", "smallest link", urdf=((PALM_BOX, '<mesh filename="speck.stl"/>'),)),
    Wrong("meshes", "panda", "palms.stl", urdf=((PALM_BOX, '<mesh filename="palms.stl"/>'),)),
    Wrong("meshes", "panda", "pad on its link", urdf=((TIP_BOX, '<mesh filename="speck.stl" scale="100 100 100"/>'),)),
    Wrong("names", "panda", "did you mean panda_finger_joint1", change=each("close", {"panda_finger_joint_1": -1})),
    Wrong(
        "names",
        "panda",
        "did you mean panda_leftfinger",
        change=top("fingers", MISNAMED),
    ),
    Wrong("names", "panda", "hand.root", change=top("root", "panda_hnd")),
    Wrong("names", "panda", "panda_finger_joint9", change=top("joints", {"panda_finger_joint9": STRONG})),
    Wrong("forces", "panda", "pad force", change=vice),
    Wrong("forces", "panda", "hand.closing.effort: expected at most 70", change=closing(500, 0.9)),
    Wrong("forces", "sdh2", "forces balance", change=three_fingers(1)),
    Wrong("groups", "sdh2", "each finger closes", change=in_groups),
    Wrong("groups", "sdh2", "symmetry", change=turned),
]
