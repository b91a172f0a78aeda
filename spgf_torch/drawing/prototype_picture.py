"""A prototype as a small picture beside a grasp that it voted for: the surface around a point, as far as it is known.

Seen obliquely from above: the point with its normal, and around it, at the feature's radius, what lies there. The upper
band is the surface on the point's own side, the lower one what faces away, such as the back of a thin wall; dashes are
directions without any surface, past a rim. A cell is as high as alpha1 says, and its colour is alpha2, the angle to the
point's normal (`style.ANGLE_SCALE`). The same geometry as in the report's Fig. 10.
"""

from __future__ import annotations

from itertools import groupby

import numpy as np
from matplotlib.colors import to_hex

from spgf_torch.drawing.prototype_rings import Ring, rings, shading
from spgf_torch.drawing.style import angle_colours, camera
from spgf_torch.errors import InputError
from spgf_torch.prototypes.naming import gaps, ring_shape

VIEW = (-60.0, 38.0)  # deg; azimuth and elevation of the camera, as in the report
UNITS = 64.0  # of the picture, along the radius: whole numbers of two digits are fine enough, and short
BOX = (-70, -67, 140, 140)  # what is shown of the plane of the picture, y downwards: cells at any height are within
CELLS = 36  # that are drawn of a ring at most, so that the picture stays small
NORMAL, AHEAD = 0.62, 0.4  # of the radius: the drawn normal, and the aligned direction


def prototype_svg(rings_deg: np.ndarray) -> str:
    """A picture of one prototype as SVG, which needs nothing else and takes the letters' colour of the page around it.

    Args:
        rings_deg: (2, cells, 2) top and bottom layer, cell, (alpha1, alpha2) in degrees: `GraspModel.rings_deg()[k]`.

    Returns:
        2 to 4 kB of text, whatever the number of cells.

    Raises:
        InputError: another shape, or numbers that are not finite.
    """
    degrees = np.asarray(rings_deg, dtype=np.float64)
    if degrees.ndim != 3 or degrees.shape[0] != 2 or degrees.shape[2] != 2 or not degrees.shape[1]:
        raise InputError(f"rings_deg: expected shape (2, cells, 2), got {degrees.shape}")
    if not np.isfinite(degrees).all():
        raise InputError("rings_deg: expected finite angles in degrees, got NaN or infinity")
    words = f"{ring_shape(degrees).name}: the surface around a point, with its normal"
    cells = degrees.shape[1]
    degrees = degrees[:, np.arange(min(CELLS, cells)) * cells // min(CELLS, cells)]
    layers = rings(degrees, (~gaps(degrees)).astype(float), UNITS)
    missing = "".join(_line(line) for layer in layers for line in layer.gap_lines)
    x, y, width, height = BOX
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{x} {y} {width} {height}" role="img"><title>{words}</title>'
        f'<path d="{missing}" stroke="currentColor" stroke-width="1.4" opacity=".45"/>'
        f'<g stroke="#0004" stroke-width=".4">{_band(layers[1])}{_inside(layers[0])}'
        f"{_band(layers[0])}</g>{_centre()}</svg>"
    )


def _band(layer: Ring) -> str:
    """The cells of a layer as filled shapes, far ones first; neighbours in this order of one colour are one path."""
    colours = [_short(colour) for colour in angle_colours(layer.alpha2_deg) * shading(layer.quads)[:, None]]
    far_first = np.argsort((layer.quads @ camera(VIEW)[2]).mean(axis=1), kind="stable").tolist()
    alike = groupby(far_first, key=lambda i: colours[i])
    shapes = ((colour, "".join(_line(layer.quads[i]) + "z" for i in own)) for colour, own in alike)
    return "".join(f'<path fill="{colour}" d="{path}"/>' for colour, path in shapes)


def _inside(layer: Ring) -> str:
    """What lies between the point and the band of its own side, of which the angles say nothing: a pale surface."""
    if not len(layer.quads):
        return ""
    edge = np.concatenate([layer.quads[:, 0], layer.quads[-1:, 3]])
    return f'<path fill="currentColor" fill-opacity=".15" stroke="none" d="{_line(edge)}z"/>'


def _centre() -> str:
    """The point with a patch of its plane, the normal as an arrow, and a line towards ring cell 0."""
    patch = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) * 0.13 * UNITS
    normal, ahead = (np.array([[0, 0, 0], tip]) * UNITS for tip in ((0, 0, NORMAL), (AHEAD, 0, 0)))
    x, y = _flat(normal[1]).tolist()
    return (
        f'<g fill="currentColor" stroke="currentColor"><path d="{_line(patch)}z" fill-opacity=".5"/>'
        f'<path d="{_line(normal)}" stroke-width="2.6"/><path d="M{x} {y - 8}l-5 9h10z"/>'
        f'<path d="{_line(ahead)}" stroke-width="1.4"/></g>'
    )


def _flat(points: np.ndarray) -> np.ndarray:
    """Points (..., 3) in the picture: (..., 2) whole numbers, y downwards."""
    flat: np.ndarray = np.rint(points @ camera(VIEW)[:2].T * [1, -1]).astype(int)
    return flat


def _line(points: np.ndarray) -> str:
    """A path over points (P, 3)."""
    flat = _flat(points)
    steps = " ".join(f"{x} {y}" for x, y in np.diff(flat, axis=0).tolist())
    return f"M{flat[0, 0]} {flat[0, 1]}l{steps}".replace(" -", "-")


def _short(colour: np.ndarray) -> str:
    """A colour (3,) as #rgb."""
    return "#" + to_hex(np.rint(15 * colour) / 15)[1::2]
