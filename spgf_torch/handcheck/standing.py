"""What a simulation of the hand alone tells: whether it stays open, and whether it closes as geometry says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from spgf_torch.handcheck.check import checked_hand
from spgf_torch.handcheck.closed import GAP
from spgf_torch.handcheck.finding import Finding, refuse
from spgf_torch.handcheck.posed import Posed
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.free_closing import FreeClosing, close_without_object

DRIFT_RAD, DRIFT_M = 2e-3, 5e-4  # that a joint may move in 50 steps: more shows in a pad's place, 0.2 mm at 0.1 m
LATE = 0.05  # of the opening, beyond `GAP`, that simulated fingers may end apart: drives give way a little


def simulated_findings(
    hand: Hand, episode: EpisodeConfig, advance: Callable[[int], None] = lambda steps: None
) -> Iterator[Finding]:
    """Every check of each preshape that takes a simulation, without an object; `advance` counts preshapes."""
    for posed in Posed.all_of(hand):
        closing = close_without_object(hand, posed.name, episode)
        yield _stays(posed, closing)
        yield from _closes(posed, closing)
        advance(1)


def tried_hand(config: HandConfig, episode: EpisodeConfig) -> Hand:
    """The hand of a description, if it passes every check, those that close it in SAPIEN too.

    Raises InputError, as `load_hand`, and for the first check that it does not pass.
    """
    hand = checked_hand(config)
    refuse(hand.config.name, list(simulated_findings(hand, episode)))
    return hand


def _stays(posed: Posed, closing: FreeClosing) -> Finding:
    """The joint that drifts farthest in the open hand, in multiples of what it may."""
    most = {n: DRIFT_M if posed.kinematics.moving[n].kind == "prismatic" else DRIFT_RAD for n in closing.drift}
    worst = max(closing.drift, key=lambda name: closing.drift[name] / most[name], default="")
    sliding = bool(worst) and posed.kinematics.moving[worst].kind == "prismatic"
    drift, unit = closing.drift.get(worst, 0.0), "mm" if sliding else "mrad"
    return Finding(
        check="stays open",
        preshape=posed.name,
        measured=f"{1000 * drift:.2f} {unit} in 50 steps" + (f" ({worst})" if worst else ""),
        expected=f"{1000 * DRIFT_RAD:g} mrad or {1000 * DRIFT_M:g} mm at most",
        ok=not worst or drift <= most[worst],
        remedy="fingers push each other, a limit pushes back, or the drive is weak: look at joints, hold and limits",
    )


def _closes(posed: Posed, closing: FreeClosing) -> Iterator[Finding]:
    of = partial(Finding, preshape=posed.name)
    yield of(
        check="joints keep to limits",
        measured=f"beyond: {', '.join(closing.exploded)}" if closing.exploded else "all within",
        expected="every joint within its limits while it closes",
        ok=not closing.exploded,
        remedy="a joint has no drive or the wrong inertia: name linkages under passive, look at joints and <inertial>",
    )
    if posed.preshape.jaw:  # fingers that curl may pass each other without an object, and go on
        yield of(
            check="stands still",
            measured="still moving" if closing.still is None else f"after {closing.still:.2f} s",
            expected=f"closing.time, {posed.preshape.closing.time:g} s, at most",
            ok=closing.still is not None,
            remedy="raise closing.time, or closing.effort, or lower the damping of its joints",
        )
    if closing.exploded:
        return
    gap = posed.gap(posed.kinematics.links(closing.end))
    most = (GAP + LATE) * posed.preshape.opening
    yield of(
        check="fingers meet simulated",
        measured=f"{1000 * max(gap, 0):.1f} mm apart at the end",
        expected=f"{1000 * most:.1f} mm at most",
        ok=gap <= most,
        remedy="the fingers close in geometry and not in simulation: look at effort, stiffness, damping and time",
    )


def _passed(posed: Posed, closing: FreeClosing) -> bool:
    """Whether all joints have closed beyond where the fingers meet, as those that stand beside each other do."""
    closed, phases = posed.preshape.closed, posed.preshape.closing.phases
    return all((closing.end[name] - closed[name]) * share > 0 for phase in phases for name, share in phase.items())
