"""Small scenes of clutter, made by hand."""

from pathlib import Path

import numpy as np
import trimesh
from composing import composed
from omegaconf import OmegaConf

from spgf_torch.clearing.config import ClutterConfig
from spgf_torch.clearing.rounds import ClearedScene, Measured
from spgf_torch.cli.command import slug
from spgf_torch.drawing.clutter_records import Clip, Round, Tried, View
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.settings import typed
from spgf_torch.simulation.arrangements import Placed

OmegaConf.register_new_resolver("slug", slug, replace=True)


def block(name, *extents, mass=0.1):
    """A box of these extents, m, base at z = 0."""
    mesh = trimesh.creation.box(extents).apply_translation((0, 0, extents[2] / 2))
    squares = np.square(extents)
    inertia = mass * np.diag(squares.sum() - squares) / 12
    com = np.array([0, 0, extents[2] / 2])
    return GraspObject(name, "boxes", mesh, (np.asarray(mesh.vertices),), mass, com, inertia)


def standing(obj, x, y):
    T = np.eye(4)
    T[:2, 3] = x, y
    return Placed(obj, T)


OBJECTS = (block("tall", 0.03, 0.04, 0.12), block("flat", 0.05, 0.06, 0.03), block("cube", 0.04, 0.04, 0.04))
PLACED = (standing(OBJECTS[0], -0.08, 0.02), standing(OBJECTS[1], 0.07, 0.03), standing(OBJECTS[2], 0.0, -0.09))


def config(hand="sdh2", **changes):
    """Settings of a quick run, with one small image; what is changed may be a part of a group."""
    small = {"sensing.width": 160, "sensing.height": 120, "sensing.focal": 144, "workers": 1, "bootstrap": 1000}
    values = OmegaConf.create(composed("clutter", f"hand={hand}", "objects=data/objects"))
    for key, value in {"film": None, **small, **changes}.items():
        OmegaConf.update(values, key, str(value) if isinstance(value, Path) else value)
    return typed(ClutterConfig, OmegaConf.to_container(values))


def scene(number, succeeded, objects=3, causes=(), probability=0.5, ended="clear"):
    """A round: whether each attempt succeeded; causes of those that did not, in order."""
    left, tried, why = list(range(objects)), [], list(causes)
    for k, success in enumerate(succeeded):
        T = np.eye(4)
        T[:3, 3] = 0.01 * k, 0.02, 0.03
        poses = np.tile(np.eye(4), (len(left), 1, 1)) * 1.0
        view = View(tuple(left), poses, np.full((4, 3), 0.1 * k, np.float32), np.eye(4)[None])
        taken = left[0] if success else None
        cause = "none" if success else why.pop(0)
        tried.append(Tried(view, "NPG", T, probability if k == 0 else 1 - probability, success, cause, taken, "cube"))
        left = left[1:] if success else left
    things = [OBJECTS[i % 3] for i in range(objects)]
    its = Round("ours", f"packed {number}", things, tried, ended, None, 0.3 * len(tried))
    return ClearedScene(number, number, None, its, tuple(Measured(0.1, 0.3, 0.2, 50, 1, 0) for _ in tried))


def clip():
    """Two frames of two objects and one link."""
    poses = np.tile(np.eye(4), (2, 2, 1, 1))
    return Clip(np.array([0.0, 0.5]), (0, 1), poses, ("palm",), poses[:, :1])
