"""The joints of a hand in a scene: what drives them, and how they close (docs/design/simulation.md)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from spgf_torch.hands.preshape import Preshape
from spgf_torch.hands.robot import Follow, Robot
from spgf_torch.simulation.config import EpisodeConfig

if TYPE_CHECKING:
    from sapien import physx

# Of joints that close: name, joint in SAPIEN, place in `qpos`, direction, how far ahead its target may run.
Plan: TypeAlias = list[tuple[str, Any, int, float, float]]


@dataclass(frozen=True)
class Begun:
    """A closing that has begun: steps since, values and speeds of the joints in SAPIEN's order, targets."""

    steps: int
    qpos: np.ndarray
    qvel: np.ndarray
    aims: Mapping[str, float]


class Fingers:
    """The fingers of one articulation, set to the open hand; `step` advances the scene that they are in.

    Attributes:
        places: joint that moves -> its place in `qpos`.
        follow: joints that follow another one that moves. linked: those that do so by the hand's mechanism.
        aims: joint that closes -> target of its drive, once it closes.
    """

    def __init__(
        self,
        articulation: physx.PhysxArticulation,
        robot: Robot,
        preshape: Preshape,
        config: EpisodeConfig,
        step: Callable[[], None],
    ) -> None:
        self.articulation, self.preshape, self.config, self.step = articulation, preshape, config, step
        active = {joint.name: (place, joint) for place, joint in enumerate(articulation.active_joints)}
        own = [name for name in active if name in preshape.joints]  # what carries the hand has others
        self.joints = {name: active[name][1] for name in own}
        self.places = {name: active[name][0] for name in own}
        articulation.set_qpos([preshape.joints.get(name, 0.0) for name in active])
        for name, joint in self.joints.items():
            drive = preshape.drives[name]
            joint.set_drive_properties(drive.stiffness, drive.damping, drive.effort)
            joint.set_drive_target(preshape.joints[name])
        self.rules = resolved(preshape.closing.follow)
        self.follow = {n: rule for n, rule in self.rules.items() if n in self.joints and rule.of in self.joints}
        mechanical = {joint.name for joint in robot.joints if joint.mimic}
        self.linked = {name: rule for name, rule in self.follow.items() if name in mechanical}
        self.aims: dict[str, float] = {}

    @property
    def qpos(self) -> np.ndarray:
        return self.articulation.qpos

    def values(self) -> dict[str, float]:
        """rad or m of every joint of the hand: those that move, are held, and follow without being simulated."""
        q = self.qpos
        values = self.preshape.joints | {name: float(q[place]) for name, place in self.places.items()}
        for name, rule in self.rules.items():
            if name not in self.joints:
                values[name] = rule.ratio * values[rule.of] + rule.offset
        return values

    def close(self, begun: Begun | None = None) -> int | None:
        """Run the targets ahead of the joints, never back, phase by phase, until the fingers stand still.

        `begun`: go on from there, in the first phase. Returns the number of steps that it took with those, or None
        where `closing.time` ended it.
        """
        closing = self.preshape.closing
        most, taken, q = round(closing.time / self.config.dt), 0, self.qpos
        self.aims = {name: float(q[self.places[name]]) for phase in closing.phases for name in phase}
        if begun is not None:
            taken, self.aims = begun.steps, dict(begun.aims)
            self.articulation.set_qpos(begun.qpos)
            self.articulation.set_qvel(begun.qvel)
        for phase in closing.phases:
            steps = self._close_phase(phase, most - taken)
            if steps is None:
                return None
            taken += steps
        return taken

    def _close_phase(self, phase: Mapping[str, float], most: int) -> int | None:
        """Close these joints until all joints that close stand still, twice in a row."""
        window, plan = self._window(), self._plan(phase)
        watched, least = [self.places[name] for name in self.aims], self._least_motion()
        q = self.qpos
        before, still = [float(q[place]) for place in watched], 0
        for step in range(1, most + 1):
            self._run_ahead(plan, q)
            self.step()
            q = self.qpos
            if step % window == 0:
                now = [float(q[place]) for place in watched]
                moved = max(abs(a - b) for a, b in zip(now, before, strict=True))
                before, still = now, still + 1 if moved < least else 0
                if still == 2:
                    return step
        return None

    def _plan(self, phase: Mapping[str, float]) -> Plan:
        return [
            (name, self.joints[name], self.places[name], math.copysign(1.0, share), self._lead(name, share))
            for name, share in phase.items()
        ]

    def _run_ahead(self, plan: Plan, q: np.ndarray) -> None:
        """Move targets on, never back, as far ahead of the joints at `q` as the effort goes; what follows follows."""
        stride = self.preshape.closing.speed * self.config.dt
        for name, joint, place, sign, lead in plan:
            target = sign * self.aims[name]
            self.aims[name] = sign * max(target, min(target + stride, sign * float(q[place]) + lead))
            joint.set_drive_target(self.aims[name])
        self.turn(self.follow, q)

    @cached_property
    def _squeezing(self) -> Plan:
        """All that closes, with its share in the last phase that moves it."""
        return self._plan({name: share for phase in self.preshape.closing.phases for name, share in phase.items()})

    def squeeze(self) -> None:
        """Keep the effort up, whatever the object does: targets run on ahead of the joints."""
        self._run_ahead(self._squeezing, self.qpos)

    def _window(self) -> int:
        return max(1, round(self.config.stall_window / self.config.dt))

    def _least_motion(self) -> float:
        """rad or m in a window, below which a joint stands still.

        More fingers than a jaw's, and more joints, creep on as the object settles between them, with whatever is left
        of the balance of their efforts; they stand still once they do so at a small share of the closing speed.
        """
        config, way = self.config, self.preshape.closing.speed * self.config.stall_window
        return config.stall_motion if self.preshape.jaw else max(config.stall_motion, config.stall_share * way)

    def _lead(self, name: str, share: float) -> float:
        """rad or m that the target of a joint may run ahead of it: its share of the effort over the stiffness."""
        return abs(share) * self.preshape.closing.effort / self.preshape.drives[name].stiffness

    def turn(self, follow: Mapping[str, Follow], q: np.ndarray) -> None:
        """Set the targets of joints that follow others, which are at `q`."""
        for name, rule in follow.items():
            self.joints[name].set_drive_target(rule.ratio * float(q[self.places[rule.of]]) + rule.offset)

    def keep_linked(self) -> None:
        """What follows by the hand's mechanism does so under load."""
        if self.linked:
            self.turn(self.linked, self.qpos)

    def settle(self, duration: float) -> None:
        """Targets of what closes frozen, what follows still following."""
        for _ in range(round(duration / self.config.dt)):
            self.turn(self.follow, self.qpos)
            self.step()


def moving_joints(preshape: Preshape) -> frozenset[str]:
    """Joints that close, and those that follow them; what follows a joint that is held stands still."""
    closes = {name for phase in preshape.closing.phases for name in phase}
    rules = resolved(preshape.closing.follow)
    return frozenset(closes | {name for name, rule in rules.items() if rule.of in closes})


def resolved(follow: Mapping[str, Follow]) -> dict[str, Follow]:
    """The same rules, each of a joint that follows no other."""
    found = {}
    for name, rule in follow.items():
        for _ in follow:  # no longer chain than there are rules
            if (of := follow.get(rule.of)) is None:
                break
            rule = Follow(of.of, rule.ratio * of.ratio, rule.ratio * of.offset + rule.offset)
        found[name] = rule
    return found
