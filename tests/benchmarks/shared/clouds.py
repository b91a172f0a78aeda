"""Texlets as the package makes them: the shipped objects as four cameras see them."""

from __future__ import annotations

from functools import lru_cache

import torch
from torch import Tensor

from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import root
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import sense
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.settings import settings

APART = 0.6  # m between objects side by side: wider than each of them and the radius of a feature


@lru_cache
def objects() -> list[GraspObject]:
    """The shipped objects, by name, but such that neighbours in the list are of different kinds."""
    found = load_objects(root() / "data" / "objects")
    return [found[(7 * i) % len(found)] for i in range(len(found))]


@lru_cache
def sensed(number: int) -> Texlets:
    return sense(objects()[number], settings(SensingConfig), 0)


def cloud(size: int) -> tuple[Tensor, Tensor]:
    """Positions and normals (size, 3) of texlets: more of them means more objects side by side, not denser ones."""
    positions: list[Tensor] = []
    normals: list[Tensor] = []
    while sum(map(len, positions)) < size:
        place = len(positions)
        texlets = sensed(place % len(objects()))
        positions.append(texlets.positions + APART * torch.tensor([place % 16, place // 16, 0]))
        normals.append(texlets.normals)
    return torch.cat(positions)[:size].contiguous(), torch.cat(normals)[:size].contiguous()
