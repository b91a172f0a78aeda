"""Checks of how a preshape closes: where the fingers meet, when, and how hard each side presses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from spgf_torch.handcheck.finding import Finding
from spgf_torch.handcheck.posed import Posed

GAP = 0.25  # of the opening that may be left between closed fingers: thinner things cannot be held
OVERLAP = 0.002  # m that closed fingers may stand in each other: what convex pieces of meshes add
TURNED_DEG = 5.0  # deg that fingers with `parallel` joints turn while they close
LEAST_LEVER = 0.001  # m per rad, or per m: a joint that moves no pad by more closes nothing
WEAKEST, STRONGEST = 1.5, 1000.0  # N of a pad; lifts 90 g between two at friction 0.6 and 2 g; a vice
UNBALANCED = 0.25  # of all force that is left over: two fingers of 1.6 Nm against one of 1.6 (0.33) drag things away


def closed_findings(posed: Posed) -> Iterator[Finding]:
    """All checks of how one preshape closes."""
    yield _each_closes(posed)
    yield _joints_close(posed)
    yield from _meets(posed)
    yield _in_time(posed)
    follow = posed.preshape.closing.follow
    if parallel := {name for name in follow.keys() - posed.mimics if abs(follow[name].ratio) == 1}:  # others curl
        yield _parallel(posed, [finger for finger in posed.preshape.pads if posed.behind(finger) & parallel])
    yield _force(posed)
    yield _balance(posed)


def _each_closes(posed: Posed) -> Finding:
    """Every finger comes nearer to the others, or stands still; one at least moves."""
    before, after = posed.preshape.pads, posed.pads_at(posed.closed_links)
    ways = {name: float((after[name] - before[name]) @ inwards) for name, inwards in posed.inwards.items()}
    worst, most = min(ways, key=ways.__getitem__), max(ways.values())
    opens = ways[worst] < -0.05 * max(most, 1e-3)
    return Finding(
        check="each finger closes",
        preshape=posed.name,
        measured=f"{1000 * ways[worst]:.1f} mm inwards ({worst})",
        expected="every finger inwards, or still" if most > 1e-3 else "a finger that moves",
        ok=most > 1e-3 and not opens,
        remedy="the sign of its joint in close, of its <mimic>, or its axis in the URDF is the other one",
    )


def _joints_close(posed: Posed) -> Finding:
    """Every joint that closes moves some pad inwards."""
    ways = {j: max(float(v @ posed.inwards[f]) for f, v in of.items()) for j, of in posed.levers.items()}
    worst = min(ways, key=ways.__getitem__)
    return Finding(
        check="joints close",
        preshape=posed.name,
        measured=f"{1000 * ways[worst]:.1f} mm inwards per rad or m ({worst})",
        expected=f"{1000 * LEAST_LEVER:g} mm or more of some pad",
        ok=ways[worst] >= LEAST_LEVER,
        remedy="this joint opens the hand or moves no finger: its sign in close, or its place is hold",
    )


def _meets(posed: Posed) -> Iterator[Finding]:
    gap = posed.gap(posed.closed_links)
    most = GAP * posed.preshape.opening
    yield Finding(
        check="fingers meet",
        preshape=posed.name,
        measured=f"{1000 * max(gap, 0):.1f} mm apart when closed",
        expected=f"a quarter of the opening, {1000 * most:.1f} mm, at most",
        ok=gap <= most,
        remedy="the fingers stop too early or pass each other: look at limits, pads, and oppose",
    )
    yield Finding(
        check="fingers do not pass",
        preshape=posed.name,
        measured=f"{1000 * max(0.0, -gap):.1f} mm in each other when closed",
        expected=f"{1000 * OVERLAP:g} mm at most",
        ok=-gap <= OVERLAP,
        remedy="pads lie below the closing faces; leave pads out, and they are measured",
    )


def _in_time(posed: Posed) -> Finding:
    closing, preshape = posed.preshape.closing, posed.preshape
    strokes = [max(abs(preshape.closed[j] - preshape.joints[j]) for j in phase) for phase in closing.phases]
    needed = sum(strokes) / closing.speed
    return Finding(
        check="closing in time",
        preshape=posed.name,
        measured=f"{needed:.2f} s at {closing.speed:g} rad/s or m/s",
        expected=f"closing.time, {closing.time:g} s, at most",
        ok=needed <= closing.time,
        remedy="raise closing.time or closing.speed; both left out, they are measured",
    )


def _parallel(posed: Posed, fingers: list[str]) -> Finding:
    """How far these fingers, which hang on joints of `parallel`, turn on their way."""
    angles = {}
    for name in fingers:
        link = posed.carriers[name]
        turn = posed.preshape.T_base_link[link][:3, :3].T @ posed.closed_links[link][:3, :3]
        cosine = (np.trace(turn) - 1) / 2
        angles[name] = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    worst = max(angles, key=angles.__getitem__, default="")
    return Finding(
        check="pads stay parallel",
        preshape=posed.name,
        measured=f"turned by {angles.get(worst, 0.0):.1f} deg" + (f" ({worst})" if worst else ""),
        expected=f"{TURNED_DEG:g} deg at most",
        ok=angles.get(worst, 0.0) <= TURNED_DEG,
        remedy="the ratio of a joint in parallel has the other sign, or it follows another finger's joint",
    )


def _force(posed: Posed) -> Finding:
    """The force of the weakest and of the strongest finger that moves."""
    forces = {name: force for name, force in posed.forces.items() if force > 0}
    weakest, strongest = (pick(forces, key=lambda name: forces[name], default="") for pick in (min, max))
    bad = strongest if forces.get(strongest, 0.0) > STRONGEST else weakest
    return Finding(
        check="pad force",
        preshape=posed.name,
        measured=f"{forces[bad]:.3g} N ({bad})" if bad else "no finger that presses",
        expected=f"{WEAKEST:g} to {STRONGEST:g} N",
        ok=bool(forces) and forces[weakest] >= WEAKEST and forces[strongest] <= STRONGEST,
        remedy="closing.effort is in Nm of joints that turn, N of those that slide; left out, it is measured",
    )


def _balance(posed: Posed) -> Finding:
    """What is left of all fingers' forces, which things in the hand are dragged by; a still finger bears anything."""
    moving = {name: force for name, force in posed.forces.items() if force > 0}
    total = sum(moving.values())
    left = np.linalg.norm(sum((force * posed.inwards[name] for name, force in moving.items()), np.zeros(3)))
    share = float(left / total) if total and len(moving) == len(posed.forces) else 0.0
    return Finding(
        check="forces balance",
        preshape=posed.name,
        measured=f"{100 * share:.0f} % of all force left over",
        expected=f"{100 * UNBALANCED:g} % at most",
        ok=share <= UNBALANCED,
        remedy="give the larger group smaller shares in close: two fingers 0.5 each against a thumb of 1",
    )
