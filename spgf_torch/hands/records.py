"""Records of a grasp, complete for execution, and of a hand as one gripper for each grasp type."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.files.checks import entries, entry, joint_values, name, number, rigid, rigid_of, whole
from spgf_torch.hands.hand import Hand

if TYPE_CHECKING:
    from spgf_torch.proposing.judge_influences import Numbers

__all__ = ["Grasp", "Gripper", "Voters", "gripper_for", "grippers_of", "make_grasp"]

RESIDUE = 1e-7  # rad or m of a joint: no hand can tell less from 0
# Keys of what a judge says: the probability that the open hand collides with nothing, and that it then holds.
_FACTORS = ("free", "holds")


@dataclass(frozen=True)
class Gripper:
    """One hand in the preshape of one grasp type.

    Attributes:
        name: hand and type, such as `sdh2_WPG`. type: the grasp type. base_link: the URDF's link of frame base.
        T_base_tcp: (4, 4) float64, of the open hand.
        joints: rad or m, every joint of the open hand.
        closed: the same with the fingers meeting, or as near as the limits let them. It is what to close towards with
            bounded force, not where the fingers end: that depends on the thickness of what lies between them.
        active: joints that are driven by themselves (no mimic joints).
        width: m between opposing pads (`Preshape.opening`).
        depth: m that the fingers reach beyond the TCP along the approach.
        height: m, extent of the fingertips across closing and approach.
        jaw: whether two fingers oppose each other, and nothing else closes: what formats of parallel jaws can say.
        symmetry: so many turns about the approach make the same grasp.
        shapes: the open hand's collision shapes, closed meshes in the tcp frame, m.
    """

    name: str
    type: str
    base_link: str
    T_base_tcp: np.ndarray
    joints: dict[str, float]
    closed: dict[str, float]
    active: tuple[str, ...]
    width: float
    depth: float
    height: float
    jaw: bool
    symmetry: int
    shapes: tuple[trimesh.Trimesh, ...] = field(repr=False)


@dataclass(frozen=True)
class Voters:
    """The V votes for one grasp, those that gained most first: which texlets, and what each said.

    Attributes:
        texlet: (V,) int64, index into the texlets that were voted with: `Scene.texlets`, of all its targets together.
        position, normal: (V, 3) float64, m and unit, of that texlet in the input's frame.
        prototype: (V,) int64, what the surface about it was taken for.
        gain: (V,) float32, what the vote added to the sum of log-odds; their mean over the votes, drawn to 0 where
            there are few, is what ranks where the votes rank. Below 0: a vote against the grasp.
        probability, support: (V,) float32, as learned: of so many trials with this shape and this relative pose (each
            counted by how near it was) this share held.
    """

    texlet: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    prototype: np.ndarray
    gain: np.ndarray
    probability: np.ndarray
    support: np.ndarray

    def __len__(self) -> int:
        return len(self.texlet)

    def transform(self, T: np.ndarray) -> Voters:
        """The same in another frame, by the rigid T (4, 4): p_other = T @ p_input; m."""
        position, normal = self.position @ T[:3, :3].T + T[:3, 3], self.normal @ T[:3, :3].T
        return replace(self, position=position, normal=normal)


@dataclass(frozen=True)
class Grasp:
    """One proposed grasp.

    Attributes:
        type: the name of a grasp type of the hand. probability: of success, 0 to 1. support: votes for it.
        T_input_tcp: (4, 4) float64, the TCP's pose with the hand still open.
        T_input_base: (4, 4) float64, the same hand's base link, axes of its URDF.
        joints: rad or m, every joint of the open hand. closed: `Gripper.closed`.
        T_input_pregrasp: (4, 4) float64, where the TCP waits before it approaches: straight back along -z of tcp. The
            base waits at T_input_base moved by the same vector.
        voted_by: (prototype, votes), most votes first.
        target: the number of what it grasps, where a scene has several (`segments`); else 1.
        score: what ranks grasps of a model: the votes' mean evidence, drawn to 0 where there are few; no probability.
        judged: of a judge P(free) and P(holds | free), whose product is the probability; None where the votes ranked.
        numbers: what the judge knew of it; None where the votes ranked, or of a grasp that was read.
        voters: the `support` votes one by one; None of a judge alone, of a grasp that was read, and while
            `Predictor.predict` asks which to keep.
        width: m between the open hand's pads; NaN of a grasp from a file that does not say.
        gripper: `Gripper.name`; empty of a grasp from a file that does not say.
    """

    type: str
    probability: float
    support: int
    T_input_tcp: np.ndarray
    T_input_base: np.ndarray
    joints: dict[str, float]
    closed: dict[str, float]
    T_input_pregrasp: np.ndarray
    voted_by: list[tuple[int, int]]
    target: int = 1
    score: float = 0.0
    judged: tuple[float, float] | None = None
    numbers: Numbers | None = field(default=None, repr=False, compare=False)
    voters: Voters | None = field(default=None, repr=False, compare=False)
    width: float = math.nan
    gripper: str = ""

    @property
    def pregrasp(self) -> np.ndarray:
        """(4, 4) float64, `T_input_pregrasp`."""
        return self.T_input_pregrasp

    def transform(self, T: np.ndarray) -> Grasp:
        """The grasp in another frame.

        Args:
            T: (4, 4) pose of the frame that the grasp is in, in the other: p_other = T @ p_input; m.

        Raises:
            InputError: T is not rigid.
        """
        T = rigid_of(T, "T")
        keys = ("T_input_tcp", "T_input_base", "T_input_pregrasp")
        voters = None if self.voters is None else self.voters.transform(T)
        return replace(self, **{key: T @ getattr(self, key) for key in keys}, voters=voters)

    def to_dict(self) -> dict[str, Any]:
        """The grasp as `grasps.json` has it: plain values, poses as 4 rows of 4 numbers."""
        return {
            "type": self.type,
            "probability": self.probability,
            "support": self.support,
            "target": self.target,
            "score": self.score,
            **({"gripper": self.gripper} if self.gripper else {}),
            **({"width": self.width} if math.isfinite(self.width) else {}),
            "T_input_tcp": self.T_input_tcp.tolist(),
            "T_input_base": self.T_input_base.tolist(),
            "T_input_pregrasp": self.T_input_pregrasp.tolist(),
            "joints": dict(self.joints),
            "closed": dict(self.closed),
            "voted_by": [{"prototype": prototype, "votes": votes} for prototype, votes in self.voted_by],
            **({"judged": dict(zip(_FACTORS, self.judged, strict=True))} if self.judged else {}),
        }

    @staticmethod
    def from_dict(values: Any, where: str = "grasp") -> Grasp:
        """The grasp of `to_dict`; keys that it does not know are passed over.

        Args:
            where: what errors call it.

        Raises:
            InputError: a key that is missing, a pose that is not rigid, a number that is not finite.
        """
        tcp, base, pregrasp = (
            rigid(entry(values, key, where), f"{where}.{key}")
            for key in ("T_input_tcp", "T_input_base", "T_input_pregrasp")
        )
        opened, closed = (joint_values(entry(values, key, where), f"{where}.{key}") for key in ("joints", "closed"))
        votes = entries(entry(values, "voted_by", where), f"{where}.voted_by")
        return Grasp(
            type=name(entry(values, "type", where), f"{where}.type"),
            probability=number(entry(values, "probability", where), f"{where}.probability", 0.0, 1.0),
            support=whole(entry(values, "support", where), f"{where}.support"),
            T_input_tcp=tcp,
            T_input_base=base,
            joints=opened,
            closed=closed,
            T_input_pregrasp=pregrasp,
            voted_by=[_vote(vote, f"{where}.voted_by[{i}]") for i, vote in enumerate(votes)],
            target=whole(values.get("target", 1), f"{where}.target"),
            score=number(values.get("score", 0.0), f"{where}.score"),
            judged=_judged(values["judged"], f"{where}.judged") if "judged" in values else None,
            width=number(values["width"], f"{where}.width", 0.0) if "width" in values else math.nan,
            gripper=name(values["gripper"], f"{where}.gripper") if "gripper" in values else "",
        )


def _judged(values: Any, where: str) -> tuple[float, float]:
    free, holds = (number(entry(values, key, where), f"{where}.{key}", 0.0, 1.0) for key in _FACTORS)
    return free, holds


def _vote(values: Any, where: str) -> tuple[int, int]:
    prototype, votes = (whole(entry(values, key, where), f"{where}.{key}") for key in ("prototype", "votes"))
    return prototype, votes


def grippers_of(hand: Hand) -> dict[str, Gripper]:
    """Grasp type -> gripper, sorted by name. Once for a hand, not once for a grasp."""
    mimics = {joint.name for joint in hand.robot.joints if joint.mimic is not None}
    grippers = {}
    for grasp_type, preshape in hand.preshapes.items():
        front = max(float(shape.bounds[1, 2]) for shape in preshape.shapes)
        tips = [shape.bounds[:, 1] for shape in preshape.shapes if shape.bounds[1, 2] > front - 1e-6]
        grippers[grasp_type] = Gripper(
            name=f"{hand.config.name}_{grasp_type}",
            type=grasp_type,
            base_link=hand.base_link,
            T_base_tcp=preshape.T_base_tcp,
            joints=_without_residues(preshape.joints),
            closed=_without_residues(preshape.closed),
            active=tuple(name for name in preshape.joints if name not in mimics),
            width=preshape.opening,
            depth=max(front, 0.0),
            height=float(np.max(tips) - np.min(tips)),
            jaw=preshape.jaw,
            symmetry=preshape.symmetry,
            shapes=preshape.shapes,
        )
    return grippers


def _without_residues(joints: Mapping[str, float]) -> dict[str, float]:
    """Joint values in which what a search for the opening left over is 0; others to the last digit, within limits."""
    return {name: 0.0 if abs(value) < RESIDUE else value for name, value in joints.items()}


def make_grasp(
    gripper: Gripper,
    T_input_tcp: np.ndarray,
    probability: float,
    support: int,
    voted_by: Sequence[tuple[int, int]],
    retreat: float,
) -> Grasp:
    """The grasp of a gripper at a pose.

    Args:
        T_input_tcp: (4, 4), float32 or float64. probability: 0 to 1. support: votes. voted_by: (prototype, votes).
        retreat: m between the pregrasp pose and the grasp.

    Raises:
        InputError: a pose that is not rigid, a probability outside 0 to 1, a negative count.
    """
    T = rigid_of(T_input_tcp, "T_input_tcp")
    back = np.eye(4)
    back[2, 3] = -number(retreat, "retreat", 0.0)
    votes = [(whole(prototype, "prototype"), whole(count, "votes")) for prototype, count in voted_by]
    return Grasp(
        type=gripper.type,
        probability=number(probability, "probability", 0.0, 1.0),
        support=whole(support, "support"),
        T_input_tcp=T,
        T_input_base=T @ np.linalg.inv(gripper.T_base_tcp),
        joints=dict(gripper.joints),
        closed=dict(gripper.closed),
        T_input_pregrasp=T @ back,
        voted_by=sorted(votes, key=lambda pair: (-pair[1], pair[0])),
        width=gripper.width,
        gripper=gripper.name,
    )


def gripper_for(grasp: Grasp, grippers: Mapping[str, Gripper]) -> Gripper:
    """The gripper of a grasp's type. Raises InputError where there is none."""
    if grasp.type not in grippers:
        raise InputError(f"grasp type: expected one of {', '.join(grippers)}; got {grasp.type}")
    return grippers[grasp.type]
