"""The hand: one URDF, read by pytorch-kinematics in this module and by SAPIEN in `episode`.

Frames: `base` is the palm (z out of it), `tcp` lies midway between the pads (+z approach, +x closing from the first
pad to the second). Everything about a hand follows from its URDF and `conf/hand/*.yaml`; there is no code for one hand.
How to add one stands at the head of `conf/hand/panda.yaml`.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import QhullError

from spgf_torch.deferred_imports import deferred
from spgf_torch.errors import InputError
from spgf_torch.files.mesh_files import mesh_arrays
from spgf_torch.files.reading import LARGEST_XML, unreadable, xml_root
from spgf_torch.hands.config import GRASP_TYPES, FingerConfig, HandConfig
from spgf_torch.paths import find
from spgf_torch.settings import plain, typed

TURN, WIDEST = 360.0, 1.0  # degrees of a joint, metres between fingers
TOUCHING = 1e-9  # m between pads that count as one point; what is left of an opening of 0 is rounding


@dataclass(frozen=True)
class Preshape:
    """The open hand before a grasp of one type.

    Attributes:
        joints: rad or m, every joint of the hand.
        T_base_tcp: (4, 4) float64.
        T_base_link: link name -> (4, 4) float64.
        shapes: collision shapes of the open hand, closed meshes in the TCP frame, m.
    """

    joints: dict[str, float]
    T_base_tcp: np.ndarray
    T_base_link: dict[str, np.ndarray]
    shapes: tuple[trimesh.Trimesh, ...]


@dataclass(frozen=True)
class Hand:
    """A hand with the preshape of every grasp type; picklable, so that workers need no kinematics.

    Attributes:
        config: roles of the joints, drives.
        urdf: path of the URDF.
        fixed: joint -> rad held throughout.
        closing: +1 where a growing proximal joint value closes the pads, else -1.
        preshapes: grasp type -> Preshape.
        digest: SHA-256 over the URDF's bytes, the settings, and the mesh files of collision shapes, if there are any.
    """

    config: HandConfig
    urdf: Path
    fixed: dict[str, float]
    closing: float
    preshapes: dict[str, Preshape] = field(repr=False)
    digest: str


def load_hand(config: HandConfig) -> Hand:
    """The hand of `config`, its preshapes computed from the wanted openings; cached by content.

    Raises InputError for a missing or unreadable URDF, a link or joint that it lacks, an opening out of reach.
    """
    path = find(config.urdf).resolve()  # workers may stand in another folder
    if not path.is_file():
        raise InputError(f"hand.urdf: expected a URDF file, got {config.urdf}")
    if (size := path.stat().st_size) > LARGEST_XML:
        raise InputError(f"{path}: expected a URDF of a hand of at most {LARGEST_XML} bytes, got {size}")
    for name, angle in config.fixed_deg.items():
        if not abs(angle) <= TURN:
            raise InputError(f"hand.fixed_deg.{name}: expected degrees from -{TURN:g} to {TURN:g}, got {angle:g}")
    for name, opening in config.openings.items():
        if not 0 <= opening <= WIDEST:
            raise InputError(f"hand.openings.{name}: expected metres from 0 to {WIDEST:g}, got {opening:g}")
    return _load(path, path.read_bytes(), json.dumps(plain(config), sort_keys=True))


@lru_cache(maxsize=8)
def _load(path: Path, urdf: bytes, settings: str) -> Hand:
    config = typed(HandConfig, json.loads(settings))
    kinematics = Kinematics(path, urdf, config)
    return Hand(
        config=config,
        urdf=path,
        fixed=kinematics.fixed,
        closing=kinematics.closing,
        preshapes={name: kinematics.preshape(opening) for name, opening in config.openings.items()},
        digest=hashlib.sha256(urdf + settings.encode() + kinematics.meshes()).hexdigest(),
    )


class Kinematics:
    """Forward kinematics of a hand (pytorch-kinematics) and what follows from it."""

    def __init__(self, path: Path, urdf: bytes, config: HandConfig) -> None:
        import torch

        with deferred("matplotlib", "pyplot", "cm"):  # a second of import, for plots of inverse kinematics
            import pytorch_kinematics as pk

        xml_root(urdf, path, "a URDF of a hand")
        try:
            self.chain = pk.build_chain_from_urdf(urdf).to(dtype=torch.float64)
            self.robot = pk.urdf.URDF.from_xml_string(urdf)
            self.root = self.robot.get_root()
        except Exception as error:  # the parser raises whatever its XML library does
            raise unreadable(path, "a URDF of a hand", error) from None
        self.path, self.config = path, config
        self.fixed = {name: math.radians(angle) for name, angle in config.fixed_deg.items()}
        self._check_names()
        self.limits = self._common_limits()
        gaps = [np.diff(self.pads(self.links(self.joints(value))), axis=0)[0] for value in self.limits]
        widest = max(gaps, key=lambda gap: float(np.linalg.norm(gap)))
        self.axis = widest / np.linalg.norm(widest)
        self.closing = 1.0 if self.opening(self.limits[1]) < self.opening(self.limits[0]) else -1.0

    def _check_names(self) -> None:
        joints, links = set(self.chain.get_joint_parameter_names()), set(self.chain.get_link_names())
        fingers = self.config.fingers
        if len(fingers) != 2 or any(len(finger.pad) != 3 for finger in fingers):
            raise InputError("hand.fingers: expected two fingers, each with a pad of three coordinates")
        if absent := set(GRASP_TYPES) - set(self.config.openings):
            raise InputError(f"hand.openings: expected one for {min(absent)}, got none")
        wanted = {finger.pad_link for finger in fingers}
        named = set(self.fixed) | {name for finger in fingers for name in (finger.proximal, finger.distal) if name}
        if self.config.base_link != self.root:
            got = self.config.base_link
            raise InputError(f"hand.base_link: expected {self.root}, the root of {self.path}; got {got}")
        for kind, missing in (("link", wanted - links), ("joint", named - joints)):
            if missing:
                raise InputError(f"{self.path}: expected a {kind} named {min(missing)}, got none")
        if sliding := {joint.name for joint in self.robot.joints if joint.type == "prismatic"} & set(self.fixed):
            raise InputError(f"hand.fixed_deg: expected joints that turn, got {min(sliding)}, which is prismatic")

    def _common_limits(self) -> tuple[float, float]:
        joints = {joint.name: joint.limit for joint in self.robot.joints}
        limits = [joints[finger.proximal] for finger in self.config.fingers]
        if None in limits:
            raise InputError(f"{self.path}: expected limits of the joints that close the fingers, got none")
        low, high = max(limit.lower for limit in limits), min(limit.upper for limit in limits)
        if not low < high:  # as when one joint closes with a growing value and the other with a falling one
            raise InputError(f"{self.path}: expected limits that both closing joints share, got {low:g} to {high:g}")
        return low, high

    def joints(self, proximal: float) -> dict[str, float]:
        """All joint values with both fingers at `proximal`, distal joints turned against them (pads parallel)."""
        values = dict.fromkeys(self.chain.get_joint_parameter_names(), 0.0) | self.fixed
        for finger in self.config.fingers:
            values[finger.proximal] = proximal
            if finger.distal:
                values[finger.distal] = -proximal
        return values

    def links(self, joints: dict[str, float]) -> dict[str, np.ndarray]:
        """Link name -> T_base_link (4, 4)."""
        import torch

        values = [[joints[name] for name in self.chain.get_joint_parameter_names()]]  # its order, not SAPIEN's
        poses = self.chain.forward_kinematics(torch.tensor(values, dtype=torch.float64))
        return {name: pose.get_matrix()[0].numpy() for name, pose in poses.items()}

    def pads(self, links: dict[str, np.ndarray]) -> np.ndarray:
        """(2, 3) pad points in the base frame."""
        return np.stack([_pad(links, finger) for finger in self.config.fingers])

    def opening(self, proximal: float) -> float:
        """Distance between the pads along the closing axis; negative once they have passed each other."""
        first, second = self.pads(self.links(self.joints(proximal)))
        return float((second - first) @ self.axis)

    def preshape(self, opening: float) -> Preshape:
        """The hand with its pads `opening` metres apart."""
        low, high = sorted(self.opening(value) for value in self.limits)
        if not low <= opening <= high:
            raise InputError(f"hand.openings: expected {max(low, 0):.3f} to {high:.3f} m, got {opening}")
        from scipy.optimize import brentq  # half a second to import

        joints = self.joints(float(brentq(lambda value: self.opening(value) - opening, *self.limits, xtol=1e-12)))
        links = self.links(joints)
        T_base_tcp = self._tcp(links)
        T_tcp_base = np.linalg.inv(T_base_tcp)
        shapes = [
            _shape(self.path, collision).apply_transform(T_tcp_base @ links[link.name] @ _origin(collision.origin))
            for link in self.robot.links
            for collision in link.collisions
        ]
        return Preshape(joints, T_base_tcp, links, tuple(shapes))

    def meshes(self) -> bytes:
        """The files of collision shapes, which stand beside the URDF."""
        shapes = [collision.geometry for link in self.robot.links for collision in link.collisions]
        names = sorted({shape.filename for shape in shapes if hasattr(shape, "filename")})
        return b"".join(_beside(self.path, name).read_bytes() for name in names)

    def _tcp(self, links: dict[str, np.ndarray]) -> np.ndarray:
        first, second = self.pads(links)
        z = np.array([0.0, 0.0, 1.0])
        x = second - first
        if np.linalg.norm(x) < TOUCHING:
            x = self.axis  # pads that touch define no direction; this is the one they came from
        x = x - (x @ z) * z
        x /= np.linalg.norm(x)
        T = np.eye(4)
        T[:3] = np.column_stack([x, np.cross(z, x), z, (first + second) / 2])
        return T


def _pad(links: dict[str, np.ndarray], finger: FingerConfig) -> np.ndarray:
    T = links[finger.pad_link]
    return T[:3, :3] @ np.asarray(finger.pad) + T[:3, 3]


def _origin(origin: Any) -> np.ndarray:
    if origin is None:
        return np.eye(4)
    T = trimesh.transformations.euler_matrix(*(origin.rpy or (0, 0, 0)))
    T[:3, 3] = origin.xyz or (0, 0, 0)
    return T


def _shape(urdf: Path, collision: Any) -> trimesh.Trimesh:
    """A collision element as a closed convex mesh in its own frame, as SAPIEN sees it."""
    mesh = _solid(urdf, collision)
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        raise InputError(f"{urdf}: expected collision shapes of finite size, got another")
    return mesh


def _solid(urdf: Path, collision: Any) -> trimesh.Trimesh:
    geometry = collision.geometry
    if hasattr(geometry, "size"):
        return trimesh.creation.box(geometry.size)
    if hasattr(geometry, "length"):
        return trimesh.creation.cylinder(geometry.radius, geometry.length)
    if hasattr(geometry, "radius"):
        return trimesh.creation.icosphere(radius=geometry.radius)
    path = _beside(urdf, geometry.filename)
    vertices, _ = mesh_arrays(path)
    try:
        return trimesh.Trimesh(vertices).apply_scale(geometry.scale or 1.0).convex_hull
    except (ValueError, QhullError) as error:  # flat, or not finite
        raise unreadable(path, "a mesh with a convex hull", error) from None


def _beside(urdf: Path, name: str) -> Path:
    """The mesh file that a URDF names: in its folder or below."""
    path = Path(name)
    if path.is_absolute() or ".." in path.parts or not (urdf.parent / path).is_file():
        raise InputError(f"{urdf}: expected the collision mesh {name} beside it, got none")
    return urdf.parent / path
