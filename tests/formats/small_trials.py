"""Two objects and eight trials, the first of which is worked out by hand.

The hand and the pose are those of tests/asymmetric.py (m; c = cos 30 deg = 0.8660254, s = 0.5):
    T_object_tcp = [0 -c s 0.1; 1 0 0 0.2; 0 s c 0.3]      T_base_tcp = [0 -1 0 0.02; 1 0 0 0; 0 0 1 0.2]
The exported gripper frame has the axes of tcp and the origin of the base, which stands at
    -R_base_tcp^T (0.02, 0, 0.2) = (0, 0.02, -0.2) in tcp, hence in the object at
    (0.1, 0.2, 0.3) + 0.02 (-c, 0, s) - 0.2 (s, 0, c)
    = (0.1 - 0.0173205 - 0.1, 0.2, 0.3 + 0.01 - 0.1732051) = (-0.0173205, 0.2, 0.1367949)
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.formats.trial_sets import TrialSet
from spgf_torch.hands.config import HandConfig, PreshapeConfig
from spgf_torch.hands.hand import Hand
from spgf_torch.hands.records import Gripper
from spgf_torch.hands.urdf import read_robot
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.settings import settings
from spgf_torch.simulation.table import OUTCOMES, Provenance, TrialTable

C, S = 0.8660254, 0.5
T_OBJECT_TCP = np.array([[0, -C, S, 0.1], [1, 0, 0, 0.2], [0, S, C, 0.3], [0, 0, 0, 1]])
T_OBJECT_GRIPPER = np.array([[0, -C, S, -0.0173205], [1, 0, 0, 0.2], [0, S, C, 0.1367949], [0, 0, 0, 1]])
W, XYZ = 0.6830127, [0.1830127, 0.1830127, 0.6830127]  # of both; worked out in asymmetric.py
EXACT = 1e-6  # the numbers above have seven digits

T_BASE_TCP = np.array([[0, -1, 0, 0.02], [1, 0, 0, 0], [0, 0, 1, 0.2], [0, 0, 0, 1.0]])
OPEN = {"left": 0.04, "right": 0.04, "shadow": 0.1}
CLOSED = {"left": 0.0, "right": 0.0, "shadow": 0.1}
URDF = """<robot name="claw">
  <link name="palm"><collision><origin xyz="0 0 0.05"/>
    <geometry><mesh filename="parts/palm.stl"/></geometry></collision></link>
  <link name="finger"><collision><geometry><box size="0.01 0.02 0.05"/></geometry></collision></link>
  <joint name="left" type="prismatic"><parent link="palm"/><child link="finger"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.05" effort="1" velocity="1"/></joint>
</robot>"""
NPG = (0, 1)  # rows of the table
OUTCOME = ("success", "collision", "dropped", "success")


def gripper(kind: str, jaw: bool = True) -> Gripper:
    width = 0.04 if kind == "NPG" else 0.08
    return Gripper(
        name=f"claw_{kind}",
        type=kind,
        base_link="palm",
        T_base_tcp=T_BASE_TCP,
        joints={**OPEN, "left": width / 2, "right": width / 2},
        closed=CLOSED,
        active=("left", "right"),
        width=width,
        depth=0.015,
        height=0.02,
        jaw=jaw,
        symmetry=2 if jaw else 3,
        shapes=(),
    )


def make_object(name: str, category: str, at: float) -> GraspObject:
    """A box of 0.06 x 0.04 x 0.1 m whose frame is not at its centre; 0.12 kg."""
    mesh = trimesh.creation.box((0.06, 0.04, 0.1)).apply_translation((at, 0.0123456789, 0.05))
    return GraspObject(name, category, mesh, (mesh.vertices.copy(),), 0.12, mesh.center_mass, np.diag([1.0, 2.0, 3.0]))


def make_table(obj: GraspObject, kinds: tuple[str, ...] = ("NPG", "WPG")) -> TrialTable:
    """Two trials of each type, the first of T_OBJECT_TCP (held) and at the origin (collision), then two dropped and
    held in turn at random places."""
    generator, count = torch.Generator().manual_seed(len(obj.name)), 2 * len(kinds)
    turns = torch.nn.functional.normalize(torch.randn(count, 4, generator=generator), dim=1)
    places = torch.rand(count, 3, generator=generator) * 0.1
    places[0], turns[0] = torch.tensor(T_OBJECT_TCP[:3, 3]), torch.tensor([W, *XYZ])
    places[1], turns[1] = torch.zeros(3), torch.tensor([1.0, 0.0, 0.0, 0.0])
    return TrialTable(
        provenance=Provenance(obj.name, obj.digest, "hand", {"jitter": 0.0}, {"friction": 0.6}, 2, 0),
        position=places.float(),
        quaternion=turns.float(),
        grasp_type=torch.arange(len(kinds)).repeat_interleave(2),
        outcome=torch.tensor([OUTCOMES.index(word) for word in (*OUTCOME[:2], *OUTCOME[2:] * (len(kinds) - 1))]),
        versions={"sapien": "3.0.3"},
        grasp_types=kinds,
    )


def small_trials(folder: Path, kinds: tuple[str, ...] = ("NPG", "WPG"), jaws: bool = True) -> TrialSet:
    """The set, with these grasp types; the hand's URDF and its mesh are written into `folder`."""
    (folder / "parts").mkdir(parents=True)
    (folder / "claw.urdf").write_text(URDF)
    (folder / "parts/palm.stl").write_bytes(trimesh.creation.box((0.1, 0.1, 0.1)).export(file_type="stl"))
    told = {"name": "claw", "urdf": str(folder / "claw.urdf"), "root": "palm", "fingers": {"a": ["finger"]}}
    config = replace(settings(HandConfig), **told, preshapes={kind: PreshapeConfig() for kind in kinds})
    hand = Hand(config, read_robot(config), {}, "hand")
    objects = [make_object("box_a", "boxes", 0.01), make_object("cup_b", "containers", -0.02)]
    rng = np.random.default_rng(0)
    clouds = [rng.uniform((-0.03, -0.02, 0), (0.03, 0.02, 0.1), (300, 3)) for _ in objects]
    up = torch.tensor([0.0, 0.0, 1.0]).expand(300, 3)
    return TrialSet(
        objects=objects,
        tables=[make_table(obj, kinds) for obj in objects],
        texlets=[Texlets(torch.from_numpy(cloud).float(), up) for cloud in clouds],
        fold=np.array([0, 1]),
        hand=hand,
        grippers={kind: gripper(kind, jaws) for kind in kinds},
    )


def nothing(done: int) -> None:
    """Progress that nobody looks at."""


def refusal(error: InputError) -> str:
    """The words of an error, which are one line."""
    assert "\n" not in str(error)
    return str(error)
