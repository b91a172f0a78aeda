"""A hand as one HTML file: the checks, and each preshape, which closes with a slider and turns under the mouse."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from spgf_torch.drawing.page import Section, caption, page, table
from spgf_torch.handcheck.finding import HEAD, Finding
from spgf_torch.handcheck.hand_scene import AXES, joint_lines, parts, poses, tcp_lines
from spgf_torch.handcheck.posed import Posed

STEPS = 20  # of the slider from open to closed
ROOM = 1.05  # of the cube that is shown, to the hand's longest side
EYE = (0.4, -1.55, 0.5)  # where the eye stands in the TCP frame, in plotly's unit: closing lies across
MM = 1000.0


def hand_page(name: str, preshapes: Sequence[Posed], findings: Sequence[Finding], lines: Sequence[str]) -> str:
    """The page of a hand, with what its checks found. `lines` of plain text stand at the head."""
    folder = files("spgf_torch.handcheck")
    styles, script = (folder.joinpath(file).read_text(encoding="utf-8") for file in ("hand_page.css", "hand_page.js"))
    lead = f"<style>\n{styles}</style>" + "".join(f"<p>{html.escape(line)}</p>" for line in lines)
    sections = [Section(f"preshape{i}", posed.name, _view(posed)) for i, posed in enumerate(preshapes)]
    sections.append(Section("checks", "Checks", _checks(findings) + f"<script>\n{script}</script>"))
    return page(f"Hand: {name}", lead, sections)


def _checks(findings: Sequence[Finding]) -> str:
    rows = []
    for finding in findings:
        state = "ok" if finding.ok else f"<b>FAILS</b>: {html.escape(finding.remedy)}"
        cells = (finding.check, finding.preshape, finding.measured, finding.expected)
        rows.append([*map(html.escape, cells), state])
    return table([*HEAD[:-1], "result"], rows, words=len(HEAD))


def _view(posed: Posed) -> str:
    content = json.dumps(_content(posed), separators=(",", ":")).replace("</", "<\\/")
    groups = " against ".join(" and ".join(map(html.escape, group)) for group in posed.groups)
    return (
        caption(
            f"{groups}, {MM * posed.preshape.opening:.0f} mm open. Dots: pads. Black: axes of joints. At the TCP, red: "
            "closing, blue: approach."
        )
        + '<div class="hand"><div class="tools"><label>open '
        f'<input type="range" min="0" max="{STEPS}" value="0"> closed</label>'
        '<label><input type="checkbox"> see through</label><span class="hint">drag to turn, point to read</span></div>'
        f'<div class="plot"></div><script type="application/json">{content}</script></div>'
    )


def _content(posed: Posed) -> dict[str, Any]:
    """What hand_page.js draws, as plain values; lengths in mm."""
    along = poses(posed, np.linspace(0, 1, STEPS + 1))
    shapes = parts(posed)
    T = posed.preshape.T_base_tcp
    corners = np.concatenate(
        [p.vertices @ links[p.link][:3, :3].T + links[p.link][:3, 3] for p in shapes for links in (along[0], along[-1])]
    )
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle, half = (low + high) / 2, ROOM * float((high - low).max()) / 2
    tcp = [
        {"points": _mm(line), "colour": colour, "text": f"TCP: {words or 'y'}"}
        for line, (colour, words) in zip(tcp_lines(posed), AXES, strict=True)
    ]
    return {
        "parts": [
            {
                "link": part.link,
                "colour": part.colour,
                "points": _mm(part.vertices),
                **dict(zip("ijk", part.faces.T.tolist(), strict=True)),
            }
            for part in shapes
        ],
        "poses": [{part.link: _pose(links[part.link]) for part in shapes} for links in along],
        "joints": [_joints(posed, index / STEPS, links) for index, links in enumerate(along)],
        "pads": [
            [{"at": _mm(pad), "text": f"pad of {name}"} for name, pad in posed.pads_at(links).items()]
            for links in along
        ],
        "tcp": tcp,
        "ranges": _mm(np.stack([middle - half, middle + half], axis=1)),
        "eye": dict(zip("xyz", (T[:3, :3] @ EYE).tolist(), strict=True)),
        "up": dict(zip("xyz", T[:3, 2].tolist(), strict=True)),
    }


def _joints(posed: Posed, fraction: float, links: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    """The axis of each joint, and words: its value, and whether it closes, follows or stands still."""
    preshape, found = posed.preshape, []
    for name, line in joint_lines(posed, links).items():
        value = preshape.joints[name] + fraction * (preshape.closed[name] - preshape.joints[name])
        sliding = posed.kinematics.moving[name].kind == "prismatic"
        shown = f"{MM * value:.1f} mm" if sliding else f"{np.degrees(value):.1f} deg"
        role = "closes" if name in posed.closing else "follows" if name in preshape.closing.follow else "is held"
        found.append({"points": _mm(line), "text": f"{html.escape(name)} {role}: {shown}"})
    return found


def _mm(metres: np.ndarray) -> Any:
    return np.round(MM * np.asarray(metres), 2).tolist()


def _pose(T: np.ndarray) -> list[float]:
    """The first three rows of T (4, 4), row by row; its translation in mm."""
    rows = T[:3].copy()
    rows[:, 3] *= MM
    return [float(value) for value in np.round(rows.ravel(), 5)]
