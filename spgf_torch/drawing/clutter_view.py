"""A round of clutter in a 3-D view: all attempts at once, each by itself, and what was left."""

from __future__ import annotations

import html
import math
from typing import Any

import numpy as np

from spgf_torch.drawing.clutter_rates import CAUSES
from spgf_torch.drawing.clutter_records import Round, Tried
from spgf_torch.drawing.clutter_scene import object_solids, open_hand, overview, table_solids
from spgf_torch.drawing.outline import outline
from spgf_torch.drawing.page import Trace
from spgf_torch.drawing.page import View as Turning
from spgf_torch.drawing.rendered import Solid, rendered
from spgf_torch.drawing.style import FAILED, HELD
from spgf_torch.hands.hand import Hand
from spgf_torch.hands.records import grippers_of

POINTS = 1500  # of a cloud that are drawn at most
HALF, CENTRE = 250.0, (0.0, 0.0, 105.0)  # mm: half a side of the cube that is drawn, and its middle
FINGER, HANDLE = 0.045, 0.07  # m of an outline behind its TCP: fingers, then the axis of approach
CAMERA_AT, CAMERA = 0.28, 0.03  # m from the table's middle where a camera is drawn, and its length
STILL = (720, 540)  # pixels of the picture where WebGL is missing
DOTS = "#1d2733"
SOFT = {"ambient": 0.7, "diffuse": 0.6, "specular": 0.05}


def round_view(each: Round, hand: Hand) -> Turning:
    """The view of a round that has an attempt or a last view; the first attempt that failed is shown at first."""
    shown = _Shown(each, hand)
    items, traces, told = [], [], []
    if each.attempts:
        items.append(f"all {len(each.attempts)}")
        traces.append([*shown.scene(0), *_outlines(each, hand)])
        told.append("The scene at the beginning, with the hands of all attempts in order.")
    for index, attempt in enumerate(each.attempts):
        items.append(f"{index + 1}: {'held' if attempt.success else f'failed, {attempt.cause}'}")
        traces.append([*shown.scene(index), shown.hand(index)])
        told.append(f"Attempt {index + 1} of {len(each.attempts)}: {_words(each, attempt)}")
    if each.last:
        items.append("the end")
        traces.append(shown.scene(len(each.attempts)))
        told.append(f"What was left and seen at the end: {each.ended}.")
    failed = [index for index, attempt in enumerate(each.attempts) if not attempt.success]
    first = failed[0] + 1 if failed else 0
    still = rendered(shown.solids(max(first - 1, 0)), overview(STILL))
    return Turning("attempt", tuple(items), tuple(traces), HALF, first, CENTRE, shown.shapes(), tuple(told), still)


class _Shown:
    """What of a round is drawn: shapes, each once, in the order table, objects, hands, clouds; and where they stand."""

    def __init__(self, each: Round, hand: Hand) -> None:
        self.attempts = each.attempts
        self.views = [*(attempt.view for attempt in each.attempts), *([each.last] if each.last else [])]
        self.names = [html.escape(one.name.replace("_", " ")) for one in each.objects]
        self.types = sorted({attempt.grasp_type for attempt in each.attempts})
        self.table, self.objects = table_solids(), object_solids(each.objects)
        self.hands = [open_hand(hand, name, HELD) for name in self.types]

    def shapes(self) -> tuple[dict[str, Any], ...]:
        """For `page.View`."""
        clouds = [{"points": _mm(_some(view.points), 0)} for view in self.views]
        return (*map(_shape, (*self.table, *self.objects, *self.hands)), *clouds)

    def scene(self, index: int) -> list[Trace]:
        """Table, objects, cloud and cameras of a view."""
        view, first = self.views[index], len(self.table)
        table = [_mesh(k, np.eye(4), solid.colour, "the table") for k, solid in enumerate(self.table)]
        objects = [
            _mesh(first + i, T, self.objects[i].colour, self.names[i])
            for i, T in zip(view.present, view.poses, strict=True)
        ]
        cloud = {"shape": first + len(self.objects) + len(self.hands) + index, "pose": _rows(np.eye(4))}
        dots = {"marker": {"size": 1.6, "color": DOTS}, "hoverinfo": "skip"}
        return [*table, *objects, {"type": "scatter3d", "mode": "markers", **cloud, **dots}, _cameras(view.cameras)]

    def hand(self, index: int) -> Trace:
        """The whole open hand of an attempt at its grasp."""
        attempt = self.attempts[index]
        shape = len(self.table) + len(self.objects) + self.types.index(attempt.grasp_type)
        return _mesh(shape, attempt.T_world_tcp, _colour(attempt), _short(attempt, index))

    def solids(self, index: int) -> list[Solid]:
        """The same of a view and its attempt, if any, in the world."""
        view = self.views[index]
        found = [*self.table, *(self.objects[i].placed(T) for i, T in zip(view.present, view.poses, strict=True))]
        if index < len(self.attempts):
            attempt = self.attempts[index]
            hand = self.hands[self.types.index(attempt.grasp_type)].placed(attempt.T_world_tcp)
            found.append(Solid(hand.vertices, hand.faces, _colour(attempt)))
        return found


def _some(points: np.ndarray) -> np.ndarray:
    points = np.asarray(points).reshape(-1, 3)
    return points[np.random.default_rng(0).permutation(len(points))[:POINTS]]


def _shape(solid: Solid) -> dict[str, Any]:
    return {"points": _mm(solid.vertices, 1), **dict(zip("ijk", solid.faces.T.tolist(), strict=True))}


def _mesh(shape: int, T: np.ndarray, colour: str, words: str) -> Trace:
    look = {"color": colour, "flatshading": True, "lighting": SOFT, "hoverinfo": "text", "text": words}
    return {"type": "mesh3d", "shape": shape, "pose": _rows(T), **look}


def _outlines(each: Round, hand: Hand) -> list[Trace]:
    """The open hands of all attempts as lines with their numbers."""
    lines = {name: outline(gripper, FINGER, HANDLE) for name, gripper in grippers_of(hand).items()}
    traces, begins = [], []
    for index, attempt in enumerate(each.attempts):
        T = attempt.T_world_tcp
        segments = lines[attempt.grasp_type] @ T[:3, :3].T + T[:3, 3]
        traces.append(_lines(segments, _colour(attempt), 6, _short(attempt, index)))
        begins.append(segments[0, 0])
    x, y, z = zip(*_mm(np.array(begins), 1), strict=True)
    ranks = [str(number) for number in range(1, len(begins) + 1)]
    text = {"text": ranks, "textfont": {"size": 14, "color": "#888888"}, "hoverinfo": "skip"}
    return [*traces, {"type": "scatter3d", "mode": "text", "x": x, "y": y, "z": z, **text}]


def _cameras(cameras: np.ndarray) -> Trace:
    """Small pyramids in the directions that the table was seen from."""
    segments = []
    for T in np.asarray(cameras).reshape(-1, 4, 4):
        tip = CAMERA_AT * T[:3, 3] / np.linalg.norm(T[:3, 3])
        base = tip + CAMERA * (T[:3, :3] @ np.array([[x, y, 1] for x, y in _BASE]).T).T
        segments += [(tip, corner) for corner in base] + list(zip(base, np.roll(base, 1, axis=0), strict=True))
    return _lines(np.array(segments).reshape(-1, 2, 3), "#888888", 4, "a camera")


def _lines(segments: np.ndarray, colour: str, width: float, words: str) -> Trace:
    points = [point for pair in segments for point in (*_mm(pair, 1), [None] * 3)] or [[None] * 3]
    x, y, z = zip(*points, strict=True)
    look = {"line": {"color": colour, "width": width}, "hoverinfo": "text", "text": words}
    return {"type": "scatter3d", "mode": "lines", "x": x, "y": y, "z": z, **look}


def _colour(attempt: Tried) -> str:
    return HELD if attempt.success else FAILED


def _short(attempt: Tried, index: int) -> str:
    return f"<b>{index + 1}</b>: {'held' if attempt.success else html.escape(attempt.cause)}{_foretold(attempt)}"


def _words(each: Round, attempt: Tried) -> str:
    """Plain text."""
    parts = [f"{attempt.grasp_type}{_foretold(attempt)}."]
    if attempt.success:
        named = f" {each.objects[attempt.taken].name}" if attempt.taken is not None else ""
        parts.append(f"Held{named}.")
    else:
        known = CAUSES.get(attempt.cause)
        parts.append(f"Failed, {attempt.cause}{f': {known}' if known else ''}.")
    if attempt.touched:
        parts.append(f"Met on the way: {attempt.touched}.")
    return " ".join(parts)


def _foretold(attempt: Tried) -> str:
    return "" if math.isnan(attempt.probability) else f", foretold {100 * attempt.probability:.0f} %"


def _rows(T: np.ndarray) -> list[float]:
    """3 x 4 numbers of a pose row by row, its translation in mm."""
    rows: list[float] = (np.hstack([np.round(T[:3, :3], 5), np.round(1000 * T[:3, 3:], 1)]) + 0.0).ravel().tolist()
    return rows


def _mm(metres: np.ndarray, digits: int) -> list[list[float]]:
    mm = np.round(1000 * metres, digits)
    values: list[list[float]] = (mm if digits else mm.astype(int)).tolist()
    return values


_BASE = ((-0.7, -0.5), (0.7, -0.5), (0.7, 0.5), (-0.7, 0.5))  # of a camera's pyramid, of its length
