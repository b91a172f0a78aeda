"""Colours and letters that all pictures share. Categorical colours are Okabe and Ito's (colour-blind safe)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap

DPI = 300
TYPE_COLOURS = {"NPG": "#0072B2", "WPG": "#D55E00", "CG": "#00795A"}
OTHER_TYPES = ("#E69F00", "#56B4E9", "#CC79A7", "#4b3c0f", "#6a2fb5", "#7fd000")  # of types with other names, in turn
# Of prototypes by id: Okabe and Ito's, then such as lie far from those before them in CIELAB and from white. The
# paper's largest K is 25.
PROTOTYPE_COLOURS = (
    *("#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#F0E442", "#4b3c0f", "#6a2fb5", "#7fd000"),
    *("#ff1ef0", "#0000e0", "#ff005a", "#b4a578", "#870f2d", "#a587ff", "#005a5a", "#0f5a00", "#00e178", "#5a3c5a"),
    *("#ff8778", "#3ce1e1", "#c30087", "#5aa500", "#808080"),
)
# Rows of a comparison, the reference first.
METHOD_COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
PAPER, CHANCE, CEILING = "#8a8a8a", "#444444", "#b9b9b9"
FAILED, HELD, COLLIDED = "#c8102e", "#1a9641", "#f2a2b3"
MESH = "#dfe5ea"
CENTRE, NEIGHBOUR, OPPOSITE = "#c8102e", "#0072B2", "#7fb7e0"  # a feature, what is near it, and what faces away
OTHER = "#d3d8dc"  # the other features of the object
TOWARDS, ALONG = "#b3202a", "#2c7d32"  # x and y of a frame: the aligned direction, R_x before it; R_y
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


def type_colours(grasp_types: Sequence[str]) -> dict[str, str]:
    """A colour for each grasp type, and for CG; types with other names than the paper's take turns."""
    others = [name for name in grasp_types if name not in TYPE_COLOURS]
    return TYPE_COLOURS | {name: OTHER_TYPES[i % len(OTHER_TYPES)] for i, name in enumerate(others)}


def prototype_colours(count: int) -> list[str]:
    """A colour for each of K prototypes by id, the same in every figure; beyond the palette they come round again."""
    return [PROTOTYPE_COLOURS[k % len(PROTOTYPE_COLOURS)] for k in range(count)]


def camera(view: tuple[float, float]) -> np.ndarray:
    """(3, 3): rows are the picture's right, up and the direction towards a camera at (azimuth, elevation) deg."""
    azimuth, elevation = np.radians(view)
    flat = np.cos(elevation)
    towards = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(towards, right), towards])
