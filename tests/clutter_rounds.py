"""A round of clutter by hand: a box, a can and a cup; the box slips, the can is taken, then there is no grasp."""

from __future__ import annotations

from functools import cache

import numpy as np
from trial_objects import box, can, cup

from spgf_torch.drawing.clutter_records import Clip, MethodRates, Round, Share, Summary, Tried, View
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.settings import settings

OBJECTS = (box((0.05, 0.08, 0.06)), can(), cup())
# A quarter turn about z, at (0.1, 0.02, 0): x of the box points along y of the world.
T_BOX = np.array([[0, -1, 0, 0.1], [1, 0, 0, 0.02], [0, 0, 1, 0], [0, 0, 0, 1.0]])
T_CAN = np.array([[1, 0, 0, -0.05], [0, 1, 0, 0.1], [0, 0, 1, 0], [0, 0, 0, 1.0]])
T_CUP = np.array([[1, 0, 0, -0.06], [0, 1, 0, -0.09], [0, 0, 1, 0], [0, 0, 0, 1.0]])
T_CAMERA = np.array([[1, 0, 0, 0], [0, -0.6, 0.8, -0.48], [0, -0.8, -0.6, 0.36], [0, 0, 0, 1.0]])
UNKNOWN = float("nan")


@cache
def hand() -> Hand:
    return load_hand(settings(HandConfig))


def above(x: float, y: float, z: float) -> np.ndarray:
    """T_world_tcp of a hand that comes from above and closes along x."""
    return np.array([[1, 0, 0, x], [0, -1, 0, y], [0, 0, -1, z], [0, 0, 0, 1.0]])


def view(present: tuple[int, ...], points: int = 300) -> View:
    """Objects at their places; the cloud is a plane at z = 50 mm."""
    poses = np.stack([(T_BOX, T_CAN, T_CUP)[i] for i in present])
    flat = np.random.default_rng(0).uniform(-0.1, 0.1, (points, 2))
    return View(present, poses, np.column_stack([flat, np.full(points, 0.05)]), T_CAMERA[None])


def clip(grasp_type: str, T_world_tcp: np.ndarray, present: tuple[int, ...], rising: int | None) -> Clip:
    """21 frames in 2 s: the open hand rises by 0.1 m/s, and one of the objects with it."""
    preshape, times = hand().preshapes[grasp_type], np.linspace(3.0, 5.0, 21)
    up = np.zeros((21, 4, 4))
    up[:, 2, 3] = 0.1 * (times - 3.0)
    objects = np.repeat(view(present).poses[None], 21, axis=0)
    if rising is not None:
        objects[:, present.index(rising)] += up
    links = list(preshape.T_base_link)
    base = T_world_tcp @ np.linalg.inv(preshape.T_base_tcp)
    poses = np.stack([base @ preshape.T_base_link[link] for link in links])
    return Clip(times, present, objects, links, poses[None] + up[:, None])


def round_(method: str = "ours", name: str = "pile 7") -> Round:
    at_box, at_can = above(0.1, 0.02, 0.05), above(-0.05, 0.1, 0.11)
    first = Tried(
        view((0, 1, 2)), "NPG", at_box, 0.62, False, "dropped", None, "cup", clip("NPG", at_box, (0, 1, 2), None)
    )
    second = Tried(view((0, 1, 2)), "WPG", at_can, UNKNOWN, True, "none", 1, "", clip("WPG", at_can, (0, 1, 2), 1))
    return Round(method, name, OBJECTS, (first, second), "no grasp", view((0, 2)), 1.25)


def rates(name: str = "ours", **causes: int) -> MethodRates:
    return MethodRates(name, 4, 12, 20, Share(0.75, 0.6, 0.9), Share(0.5, UNKNOWN, UNKNOWN), causes, UNKNOWN)


def summary() -> Summary:
    return Summary("Piles <3", [rates("ours", dropped=4, strange=1), rates("random", empty=5)], ["a & b"], ["c < d"])
