"""What every format shares: names, meshes, sensed clouds, the hand, the folds as lists of files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation
from trimesh.exchange.obj import export_obj

from spgf_torch.errors import InputError
from spgf_torch.files.checks import entry, joint_values, name, rigid
from spgf_torch.files.reading import json_values, text
from spgf_torch.formats.trial_sets import TrialSet, gripper_frame
from spgf_torch.hands.records import Gripper

if TYPE_CHECKING:
    from spgf_torch.hands.hand import Hand
    from spgf_torch.objects.grasp_object import GraspObject

SCHEMA = 1
DIGITS = 9  # decimals of numbers in text: a nanometre
MESHES, CLOUDS, HAND, PIECES = "meshes", "clouds", "hand", "pieces"
JOINTS = "joints.json"


@dataclass(frozen=True)
class HandJoints:
    """A hand in the preshape of one grasp type.

    Attributes:
        gripper: its name. joints, closed: joint -> rad or m, of the open hand and with the pads touching.
    """

    gripper: str
    joints: dict[str, float]
    closed: dict[str, float]


@dataclass(frozen=True)
class GripperJoints(HandJoints):
    """The sidecar of formats without joints: every grasp beside it was tried with this open hand.

    Attributes:
        T_gripper_base, T_gripper_tcp: (4, 4) float64; base is the hand's base link with the axes of its own URDF.
    """

    T_gripper_base: np.ndarray
    T_gripper_tcp: np.ndarray


def object_id(obj: GraspObject) -> str:
    """The name without `_`: ACRONYM's loaders split `<Category>_<id>_<scale>` at each."""
    return obj.name.replace("_", "-")


def mesh_file(obj: GraspObject) -> str:
    """The object's mesh, relative to the data set: where ACRONYM and GraspGen look for it."""
    return f"{MESHES}/{obj.category}/{object_id(obj)}.obj"


def rounded(values: np.ndarray) -> list[Any]:
    """Nested lists with `DIGITS` decimals and no negative zero."""
    return (np.round(np.asarray(values, dtype=np.float64), DIGITS) + 0.0).tolist()


def write_common(folder: Path, trials: TrialSet, advance: Callable[[int], None]) -> None:
    """Meshes in m (scaled, not recentred: as the trials used them), clouds (N, 6) float32, the hand.

    Raises InputError where two objects differ only in `_` and `-`.
    """
    taken: dict[str, str] = {}
    for obj, texlets in zip(trials.objects, trials.texlets, strict=True):
        if other := taken.get(object_id(obj)):
            raise InputError(f"objects: expected names that differ in more than _ and -, got {other} and {obj.name}")
        taken[object_id(obj)] = obj.name
        path = folder / mesh_file(obj)
        path.parent.mkdir(parents=True, exist_ok=True)
        content = export_obj(obj.mesh, include_normals=False, include_color=False, include_texture=False, digits=DIGITS)
        path.write_text(content)
        cloud = np.concatenate([texlets.positions.numpy(), texlets.normals.numpy()], axis=1)
        (folder / CLOUDS).mkdir(exist_ok=True)
        np.save(folder / CLOUDS / f"{obj.name}.npy", cloud.astype(np.float32))
        advance(1)
    for gripper in trials.grippers.values():
        write_hand(folder / HAND, trials.hand, gripper)
        write_joints(folder / HAND / f"{gripper.name}.json", gripper)


def write_hand(folder: Path, hand: Hand, gripper: Gripper) -> None:
    """A URDF of the hand with one more link, called as the gripper: its root, in the exported gripper frame.

    So the grasps are poses of a link that any program can load. What it collides with are convex shapes; those that
    were cut out of mesh files stand in `pieces`.
    """
    folder.mkdir(exist_ok=True)
    robot = ElementTree.fromstring(hand.robot.xml)
    links = {link.get("name"): link for link in robot.iter("link")}
    joints = {joint.get("name"): joint for joint in robot.iter("joint")}
    for number, piece in enumerate(piece for piece in hand.robot.collisions if piece.cut):
        file = folder / PIECES / f"{number}.obj"
        file.parent.mkdir(exist_ok=True)
        file.write_text(export_obj(piece.mesh, include_normals=False, digits=DIGITS))
        shape = ElementTree.SubElement(links[piece.link], "collision")
        shape.append(_origin(piece.T_link_shape))
        geometry = ElementTree.SubElement(shape, "geometry")
        ElementTree.SubElement(geometry, "mesh", filename=f"{PIECES}/{file.name}")
    for told in hand.robot.joints:
        if (mimic := told.mimic) is not None:
            values = {"joint": mimic.of, "multiplier": f"{mimic.ratio:.12g}", "offset": f"{mimic.offset:.12g}"}
            ElementTree.SubElement(joints[told.name], "mimic", values)
    link = ElementTree.Element("link", name=gripper.name)
    joint = ElementTree.Element("joint", name=f"{gripper.name}_base_joint", type="fixed")
    joint.append(_origin(np.linalg.inv(gripper.T_base_tcp @ gripper_frame(gripper))))
    ElementTree.SubElement(joint, "parent", link=gripper.name)
    ElementTree.SubElement(joint, "child", link=gripper.base_link)
    robot[:0] = [link, joint]
    ElementTree.indent(robot)
    (folder / f"{gripper.name}.urdf").write_bytes(ElementTree.tostring(robot) + b"\n")


def write_joints(path: Path, gripper: Gripper) -> None:
    """The sidecar `GripperJoints`, and what else is known of the gripper."""
    T_tcp_gripper = gripper_frame(gripper)
    T_gripper_tcp = np.linalg.inv(T_tcp_gripper)
    known = {
        "schema": SCHEMA,
        "gripper": gripper.name,
        "joints": gripper.joints,
        "closed": gripper.closed,
        "active": list(gripper.active),
        "width": gripper.width,
        "base_link": gripper.base_link,
        "T_gripper_base": rounded(T_gripper_tcp @ np.linalg.inv(gripper.T_base_tcp)),
        "T_gripper_tcp": rounded(T_gripper_tcp),
        "urdf": f"{HAND}/{gripper.name}.urdf",
    }
    path.write_text(json.dumps(known, indent=1) + "\n")


def read_joints(path: Path) -> GripperJoints:
    """The sidecar. Raises InputError in one line for a file that is missing, cut off or another."""
    known = json_values(path, "the joints of a gripper")
    if (got := entry(known, "schema", str(path))) != SCHEMA:
        raise InputError(f"{path}: expected schema {SCHEMA}, got {got!r:.40}")
    poses = (rigid(entry(known, key, str(path)), f"{path}: {key}") for key in ("T_gripper_base", "T_gripper_tcp"))
    return GripperJoints(*hand_joints(known, str(path)), *poses)


def hand_joints(values: Any, where: str) -> tuple[str, dict[str, float], dict[str, float]]:
    """Return the gripper's name, the open and the closed joints (rad or m) of an entry; `where` names it in errors."""
    opened, closed = (joint_values(entry(values, key, where), f"{where}.{key}") for key in ("joints", "closed"))
    return name(entry(values, "gripper", where), f"{where}.gripper"), opened, closed


def write_splits(folder: Path, trials: TrialSet, line: Callable[[GraspObject], str]) -> None:
    """`fold{F}/train.txt` and `valid.txt`, a line an object: the objects of fold F are valid, the others train."""
    for fold in np.unique(trials.fold).tolist():
        (folder / f"fold{fold}").mkdir(parents=True)
        for word, chosen in (("train", trials.fold != fold), ("valid", trials.fold == fold)):
            lines = [line(obj) for obj, belongs in zip(trials.objects, chosen, strict=True) if belongs]
            (folder / f"fold{fold}" / f"{word}.txt").write_text("".join(f"{entry}\n" for entry in lines))


def read_split(path: Path) -> list[str]:
    """The lines of a split."""
    return [line for line in text(path, "a list of objects").splitlines() if line]


def _words(values: np.ndarray) -> str:
    return " ".join(f"{value:.12g}" for value in values + 0.0)


def _origin(T: np.ndarray) -> ElementTree.Element:
    """The element of a pose (4, 4)."""
    return ElementTree.Element(
        "origin", xyz=_words(T[:3, 3]), rpy=_words(Rotation.from_matrix(T[:3, :3]).as_euler("xyz"))
    )
