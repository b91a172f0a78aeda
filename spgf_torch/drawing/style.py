"""Colours and letters that all pictures share. Categorical colours are Okabe and Ito's (colour-blind safe)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, to_hex, to_rgb

from spgf_torch.prototypes.naming import FAMILIES, family_of

DPI = 300
TYPE_COLOURS = {"NPG": "#0072B2", "WPG": "#D55E00", "CG": "#00795A"}
FAMILY_COLOURS = dict(zip(FAMILIES, ("#7a7a7a", "#0072B2", "#E69F00", "#009E73", "#B0508F"), strict=True))
# Rows of a comparison, the reference first.
METHOD_COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
PAPER, CHANCE, CEILING = "#8a8a8a", "#444444", "#b9b9b9"
FAILED, HELD = "#c8102e", "#1a9641"
MESH = "#dfe5ea"
OBSTACLE, TABLE = "#7d9cc0", ("#f3efe6", "#ebe5d8")  # of scenes: other things; a table's tiles in turn
LIGHT = np.array([0.35, -0.55, 0.76]) / np.linalg.norm([0.35, -0.55, 0.76])  # towards the lamp: front right, above

# The paper's red to green; lightness falls, too, so that it can be read without telling red from green.
SUCCESS_SCALE = [(0.0, "#c8102e"), (0.5, "#f3b33d"), (1.0, "#0f6b37")]
# The angle to the centre's normal, 0 to 180 deg: light yellow over teal (90) to dark violet.
ANGLE_SCALE = [(0.0, "#fde725"), (0.25, "#7ad151"), (0.5, "#1f968b"), (0.75, "#33638d"), (1.0, "#440154")]

LETTERS: Any = {  # matplotlib types its keys by version
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "svg.fonttype": "none",
    "svg.hashsalt": "spgf_torch",
}


def scale(stops: Sequence[tuple[float, str]]) -> LinearSegmentedColormap:
    """A colour scale of (position in [0, 1], colour) in matplotlib's form."""
    return LinearSegmentedColormap.from_list("scale", list(stops))


def success_colours(probability: np.ndarray) -> np.ndarray:
    """(N, 3) colours of probabilities (N,): red 0 to green 1."""
    return scale(SUCCESS_SCALE)(np.clip(probability, 0, 1))[:, :3]


def angle_colours(degrees: np.ndarray) -> np.ndarray:
    """(N, 3) colours of angles to the centre's normal (N,), 0 to 180 deg."""
    return scale(ANGLE_SCALE)(np.clip(degrees / 180, 0, 1))[:, :3]


def prototype_colours(names: Sequence[str]) -> list[str]:
    """A colour for each prototype: its family's, in shades from dark to light within the family."""
    members: Mapping[str, list[int]] = {
        family: [k for k, name in enumerate(names) if family_of(name) == family] for family in FAMILIES
    }
    return [
        _shade(name, members[family_of(name)].index(k), len(members[family_of(name)])) for k, name in enumerate(names)
    ]


def _shade(name: str, i: int, of: int) -> str:
    """Mixed with black (the first of a family) to mixed with white (the last)."""
    share = np.linspace(-0.5, 0.55, of)[i] if of > 1 else 0.0
    mixed = np.asarray(to_rgb(FAMILY_COLOURS[family_of(name)])) * (1 - abs(share)) + max(share, 0.0)
    return to_hex(mixed.tolist())


def camera(view: tuple[float, float]) -> np.ndarray:
    """(3, 3): rows are the picture's right, up and the direction towards a camera at (azimuth, elevation) deg."""
    azimuth, elevation = np.radians(view)
    flat = np.cos(elevation)
    towards = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(towards, right), towards])
