"""One grasp in clutter: the hand comes along its approach, closes, squeezes on, lifts, and what became of all objects.

The protocol is VGN's and GIGA's with a lift of its own; its numbers are in conf/attempt. The hand flies free: its base
is carried without turning. What an attempt does follows from what it is given alone, to the bit.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from spgf_torch.simulation.arrangements import inside, rested
from spgf_torch.simulation.carried import CarriedHandBuilder, Carrier
from spgf_torch.simulation.clutter_config import ArrangementConfig, AttemptConfig
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.fingers import Fingers
from spgf_torch.simulation.motion import Motion, Recorder
from spgf_torch.simulation.tabletop import Placed, Tabletop, configure, material_of
from spgf_torch.simulation.touching import TABLE, Touching

if TYPE_CHECKING:
    from spgf_torch.hands.hand import Hand

OUTCOMES = ("success", "failed")
# Why an attempt failed: the open hand met something at its pregrasp; met an object, or the table first, on its
# approach; closed on nothing; had an object on too few sides; lost it on lifting; lifted more than one.
CAUSES = ("none", "pregrasp", "approach", "table", "empty", "missed", "dropped", "several")
STEEP = 0.5  # cosine of 60 deg: an approach farther off the vertical retreats upwards; the field's


@dataclass(frozen=True)
class Attempt:
    """How an attempt ended; objects are named by their place in what was given to it.

    Attributes:
        outcome: one of `OUTCOMES`. cause: one of `CAUSES`.
        taken: the object that was lifted out, of a success.
        touched: what the hand met before it closed, the first first; `TABLE` is the table.
        gripped: what the opposing fingers touched once closed.
        disturbed: what else moved. lost: what else left the workspace.
        placed: what is left, at rest, in its order.
        motion: of hand and objects, for a film.
        seconds: of the processor.
    """

    outcome: str
    cause: str
    taken: int | None
    touched: tuple[int, ...]
    gripped: tuple[int, ...]
    disturbed: tuple[int, ...]
    lost: tuple[int, ...]
    placed: tuple[Placed, ...]
    motion: Motion | None = field(default=None, repr=False)
    seconds: float = 0.0


class Attempts:
    """Attempts of one hand; what does not change between them is made once."""

    def __init__(
        self, hand: Hand, episode: EpisodeConfig, config: AttemptConfig, arrangement: ArrangementConfig
    ) -> None:
        """`episode`: solver, friction, when fingers stand still. `arrangement`: how what is left comes to rest."""
        self.hand, self.episode, self.config, self.arrangement = hand, episode, config, arrangement
        self._builders: dict[str, CarriedHandBuilder] = {}

    def run(self, placed: Sequence[Placed], T_world_tcp: np.ndarray, grasp_type: str, film: bool = False) -> Attempt:
        """Try the grasp of a type at T_world_tcp (4, 4) among objects at rest."""
        begun = time.process_time()
        trial = _Trial(self, placed, np.asarray(T_world_tcp, dtype=np.float64), grasp_type, film)
        start = trial.tabletop.poses()
        cause = trial.run()
        taken = trial.held[0] if cause == "none" else None
        left = [index for index in range(len(placed)) if index != taken]
        ended = self._ended(placed, left, start, trial.tabletop.poses())
        lost = tuple(k for k in left if not inside(ended[k], self.arrangement))
        moved = [k for k in left if np.linalg.norm(ended[k].centre - placed[k].centre) > self.config.disturbed]
        return Attempt(
            outcome="success" if cause == "none" else "failed",
            cause=cause,
            taken=taken,
            touched=tuple(trial.touched),
            gripped=tuple(sorted(trial.gripped)),
            disturbed=tuple(k for k in moved if k not in lost),
            lost=lost,
            placed=tuple(ended[k] for k in left if k not in lost),
            motion=trial.recorder.motion() if trial.recorder else None,
            seconds=time.process_time() - begun,
        )

    def _ended(
        self, placed: Sequence[Placed], left: Sequence[int], start: Sequence[np.ndarray], end: Sequence[np.ndarray]
    ) -> list[Placed]:
        """Where all are, those that are left at rest again; where none of these has moved, they stay as they were."""
        same = [np.array_equal(T, before) for T, before in zip(end, start, strict=True)]
        ended = [each if still else Placed(each.obj, T) for each, still, T in zip(placed, same, end, strict=True)]
        if not all(same[k] for k in left):
            for k, each in zip(left, rested([ended[k] for k in left], self.arrangement), strict=True):
                ended[k] = each
        return ended

    def builder(self, grasp_type: str) -> CarriedHandBuilder:
        """What builds the hand for grasps of one type."""
        if grasp_type not in self._builders:
            configure(self.episode)
            preshape, material = self.hand.preshapes[grasp_type], material_of(self.episode)
            self._builders[grasp_type] = CarriedHandBuilder(self.hand.robot, preshape, material, self.config)
        return self._builders[grasp_type]


class _Trial:
    """The phases of one attempt."""

    def __init__(
        self, attempts: Attempts, placed: Sequence[Placed], T_world_tcp: np.ndarray, grasp_type: str, film: bool
    ) -> None:
        self.config, self.episode, hand = attempts.config, attempts.episode, attempts.hand
        builder, preshape = attempts.builder(grasp_type), hand.preshapes[grasp_type]
        self.placed, self.touch, self.approach = placed, preshape.touch, T_world_tcp[:3, 2]
        self.tabletop = Tabletop(placed, self.episode, asleep=True)
        T_world_base = T_world_tcp @ np.linalg.inv(preshape.T_base_tcp)
        T_world_base[:3, 3] -= self.config.approach * self.approach
        articulation = builder.build(self.tabletop.scene, T_world_base)
        self.carrier = Carrier(articulation, T_world_base, self.config)
        self.fingers = Fingers(articulation, hand.robot, preshape, self.episode, self._step)
        self.touching = Touching(self.tabletop, articulation, builder.group_shapes(articulation, hand.robot, preshape))
        self.recorder = Recorder(hand, T_world_base, self.config.frame_time) if film else None
        self.touched: list[int] = []
        self.gripped: dict[int, set[int]] = {}
        self.held: list[int] = []

    def run(self) -> str:
        """The cause of failure, one of `CAUSES`."""
        self._step()
        if self._met():
            return "pregrasp"
        self._come()
        self.fingers.close()
        self._squeeze(self.config.wait)
        self.gripped = self.touching.groups()
        before, rise = self._heights(), self._lift()
        self._squeeze(self.config.hold_time)
        lifted = np.flatnonzero(self._heights() - before > self.config.lifted * rise).tolist()
        on = self.touching.impulses()
        self.held = [index for index in lifted if index in on]
        return self._cause(len(lifted))

    def _cause(self, lifted: int) -> str:
        if lifted > 1:
            return "several"
        if self.held:
            return "none"
        if self.touched:
            return "table" if self.touched[0] == TABLE else "approach"
        if not self.gripped:
            return "empty"
        return "dropped" if max(map(len, self.gripped.values())) >= self.touch else "missed"

    def _step(self) -> None:
        self.tabletop.system.step()
        if self.recorder is not None:
            self.recorder.note(self.episode.dt, self.tabletop, self.fingers, self.carrier.way)

    def _met(self) -> bool:
        """Whether the hand presses on anything, which is noted."""
        impulses = self.touching.impulses()
        met = [index for index, impulse in impulses.items() if impulse > self.config.touch_impulse]
        self.touched += sorted(set(met) - set(self.touched))
        return bool(met)

    def _come(self) -> None:
        """Come straight along the approach, up to the first contact if that ends it, and wait there."""
        steps = round(self.config.approach / self.config.approach_speed / self.episode.dt)
        for step in range(1, steps + 1):
            self.carrier.go(self.config.approach * step / steps * self.approach)
            self._step()
            if self._met() and self.config.stop_at_contact:
                self.carrier.go(self.carrier.way)
                break
        for _ in range(round(self.config.wait / self.episode.dt)):
            self._step()

    def _squeeze(self, seconds: float) -> None:
        """Keep the effort up for a while."""
        for _ in range(round(seconds / self.episode.dt)):
            self.fingers.squeeze()
            self._step()

    def _lift(self) -> float:
        """Retreat, speed rising and falling smoothly, squeezing on; m that the hand is to rise."""
        start, way = self.carrier.way, np.array([0.0, 0.0, self.config.lift])
        if self.config.retreat == "back" and -self.approach[2] >= STEEP:
            way = -self.config.lift * self.approach
        steps = round(self.config.lift_time / self.episode.dt)
        for step in range(1, steps + 1):
            part = step / steps
            self.carrier.go(start + way * part * part * (3 - 2 * part))
            self.fingers.squeeze()
            self._step()
        return float(way[2])

    def _heights(self) -> np.ndarray:
        """(N,) m of the objects' centres of mass."""
        pairs = zip(self.placed, self.tabletop.poses(), strict=True)
        return np.array([Placed(each.obj, T).centre[2] for each, T in pairs])
