"""The round of one scene: sense, plan, try, again and again, until it is clear or there is no going on."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from spgf_torch.clearing.cameras import cameras_of, depth_images, scene_config, seen
from spgf_torch.clearing.config import FIND, ClutterConfig
from spgf_torch.clearing.methods import Chosen, Method, Sensed
from spgf_torch.drawing.clutter_records import Clip, Round, Tried, View
from spgf_torch.errors import InputError
from spgf_torch.simulation.arrangements import Placed
from spgf_torch.simulation.attempts import Attempt, Attempts
from spgf_torch.simulation.touching import TABLE

CLEAR, FAILED, NO_GRASP, NOTHING_SEEN = "clear", "failures in a row", "no grasp", "nothing seen"
SUCCESS = "success"
# Streams of random numbers of a scene, beside that of its arrangement.
_NOISE, _TEXLETS, _METHOD = 1, 2, 3

T = TypeVar("T")


@dataclass(frozen=True)
class Measured:
    """What is counted of one attempt.

    Attributes:
        sensing, planning, execution: seconds of the processor. texlets: that were sensed.
        disturbed: how many objects it moved, beside what it took. lost: how many it pushed off the workspace.
    """

    sensing: float
    planning: float
    execution: float
    texlets: int
    disturbed: int
    lost: int


@dataclass(frozen=True)
class ClearedScene:
    """What became of a scene.

    Attributes:
        number: from 0. seed: of the scene. fold: whose model planned; None: one for all.
        measured: of each attempt.
    """

    number: int
    seed: int
    fold: int | None
    round: Round
    measured: tuple[Measured, ...]


@dataclass(frozen=True)
class Bench:
    """What rounds need beside the scene: a method, and who executes its grasps."""

    config: ClutterConfig
    method: Method
    attempts: Attempts

    def sense(self, placed: Sequence[Placed], stream: tuple[int, int]) -> Sensed:
        """The scene as the cameras see it; `stream`: its seed and the number of the attempt.

        Raises InputError where nothing is seen.
        """
        config, cameras = self.config, cameras_of(self.config.sensing, self.config.views)
        views = depth_images(placed, cameras, config.sensing, np.random.default_rng([*stream, _NOISE]))
        scene = seen(views, scene_config(config.table == FIND), config.sensing, [*stream, _TEXLETS])
        return Sensed(views, scene, int(np.random.default_rng([*stream, _METHOD]).integers(2**31)))

    def clear(self, placed: Sequence[Placed], seed: int, filmed: bool) -> tuple[Round, tuple[Measured, ...]]:
        """The round of a settled scene, and what was measured of each attempt; `filmed`: with the motion of each."""
        present, left = list(range(len(placed))), tuple(placed)
        tried: list[Tried] = []
        measured: list[Measured] = []
        avoid: list[np.ndarray] = []
        ended, last = CLEAR, None
        while left:
            if failures_at_the_end(tried) == self.config.failures:
                ended = FAILED
                break
            try:
                sensed, sensing = _timed(partial(self.sense, left, (seed, len(tried))))
            except InputError:
                ended = NOTHING_SEEN
                break
            last = _view(present, left, sensed)
            chosen, planning = _timed(partial(self.method.choose, sensed, np.reshape(avoid, (-1, 3))))
            if chosen is None:
                ended = NO_GRASP
                break
            run, execution = _timed(partial(self._run, left, chosen, filmed))
            tried.append(_tried(last, chosen, run, left))
            spent = sensing, planning + chosen.seconds, execution
            measured.append(Measured(*spent, len(sensed.scene.texlets), len(run.disturbed), len(run.lost)))
            present = [i for k, i in enumerate(present) if k != run.taken and k not in run.lost]
            left, last = run.placed, None
            avoid = [*avoid, chosen.T_world_tcp[:3, 3]] if self.config.remember and not tried[-1].success else []
        objects = [each.obj for each in placed]
        planned = sum(its.planning for its in measured)
        return Round(self.config.method, "", objects, tried, ended, last, planned), tuple(measured)

    def _run(self, placed: Sequence[Placed], chosen: Chosen, filmed: bool) -> Attempt:
        return self.attempts.run(placed, chosen.T_world_tcp, chosen.grasp_type, film=filmed)


def failures_at_the_end(tried: Sequence[Tried]) -> int:
    """How many attempts in a row have failed."""
    return next((back for back, each in enumerate(reversed(tried)) if each.success), len(tried))


def _tried(view: View, chosen: Chosen, run: Attempt, placed: Sequence[Placed]) -> Tried:
    motion, clip = run.motion, None
    if motion is not None:
        clip = Clip(motion.times, view.present, motion.objects, motion.link_names, motion.links)
    touched = ", ".join("table" if index == TABLE else placed[index].obj.name for index in run.touched)
    taken = None if run.taken is None else view.present[run.taken]
    success = run.outcome == SUCCESS
    its = chosen.grasp_type, chosen.T_world_tcp, chosen.probability
    return Tried(view, *its, success, run.cause, taken, touched, clip)


def _view(present: Sequence[int], placed: Sequence[Placed], sensed: Sensed) -> View:
    points = np.concatenate([sensed.scene.texlets.positions.numpy(), sensed.scene.obstacles.numpy()])
    cameras = np.stack([view.camera.T_object_camera for view in sensed.views])
    return View(tuple(present), np.stack([each.T_world_object for each in placed]), points.astype(np.float32), cameras)


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    """What `work` returns, and its seconds of the processor."""
    start = time.process_time()
    return work(), time.process_time() - start
