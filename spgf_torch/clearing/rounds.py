"""The round of one scene: sense, plan, try, again and again, until it is clear or there is no going on."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from spgf_torch.clearing.cameras import cameras_of, depth_images, scene_config, seen
from spgf_torch.clearing.config import FIND, ClutterConfig
from spgf_torch.clearing.methods import Chosen, Method, Sensed
from spgf_torch.drawing.clutter_records import Clip, Round, Tried, View
from spgf_torch.errors import InputError
from spgf_torch.simulation.arrangements import Placed
from spgf_torch.simulation.attempts import Attempt, Attempts

CLEAR, FAILED, NO_GRASP, NOTHING_SEEN = "clear", "failures in a row", "no grasp", "nothing seen"
SUCCESS = "success"
# Streams of random numbers of a scene, beside that of its arrangement.
_NOISE, _TEXLETS, _METHOD = 1, 2, 3

T = TypeVar("T")


@dataclass(frozen=True)
class Seconds:
    """Of the processor, of one attempt."""

    sensing: float
    planning: float
    execution: float


@dataclass(frozen=True)
class ClearedScene:
    """What became of a scene.

    Attributes:
        number: from 0. seed: of the scene. fold: whose model planned; None: one for all.
        seconds: of each attempt. texlets: of each, how many were sensed.
    """

    number: int
    seed: int
    fold: int | None
    round: Round
    seconds: tuple[Seconds, ...]
    texlets: tuple[int, ...]


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

    def clear(self, placed: Sequence[Placed], seed: int, filmed: bool) -> tuple[Round, list[Seconds], list[int]]:
        """The round of a settled scene, seconds and texlets of each attempt; `filmed`: with the motion of each."""
        present, left = tuple(range(len(placed))), tuple(placed)
        tried: list[Tried] = []
        seconds: list[Seconds] = []
        texlets: list[int] = []
        avoid: list[np.ndarray] = []
        ended, last = CLEAR, None
        while left:
            try:
                sensed, sensing = _timed(lambda: self.sense(left, (seed, len(tried))))  # noqa: B023
            except InputError:
                ended = NOTHING_SEEN
                break
            last = _view(present, left, sensed)
            chosen, planning = _timed(lambda: self.method.choose(sensed, np.array(avoid).reshape(-1, 3)))  # noqa: B023
            if chosen is None:
                ended = NO_GRASP
                break
            run, execution = _timed(lambda: self._run(left, chosen, filmed))  # noqa: B023
            tried.append(_tried(last, chosen, run))
            seconds.append(Seconds(sensing, planning + chosen.seconds, execution))
            texlets.append(len(sensed.scene.texlets))
            present, left = still_there(present, left, run), run.placed
            avoid = [*avoid, chosen.T_world_tcp[:3, 3]] if self.config.remember and not tried[-1].success else []
            last = None
            if failures_at_the_end(tried) == self.config.failures:
                ended = CLEAR if not left else FAILED
                break
        objects = [each.obj for each in placed]
        spent = sum(its.planning for its in seconds)
        return Round(self.config.method, "", objects, tried, ended, last, spent), seconds, texlets

    def _run(self, placed: Sequence[Placed], chosen: Chosen, filmed: bool) -> Attempt:
        return self.attempts.run(placed, chosen.T_world_tcp, chosen.grasp_type, film=filmed)


def failures_at_the_end(tried: Sequence[Tried]) -> int:
    """How many attempts in a row have failed."""
    return next((back for back, each in enumerate(reversed(tried)) if each.success), len(tried))


def still_there(present: Sequence[int], before: Sequence[Placed], run: Attempt) -> tuple[int, ...]:
    """Indices into the scene's objects of what an attempt left: `present` without what it took, or what rolled away.

    What is left keeps its order. Of equal objects the first ones stay, which is as good as any.
    """
    rest = [i for k, i in enumerate(present) if k != run.taken]
    objects = {i: before[k].obj for k, i in enumerate(present)}
    kept = []
    for each in run.placed:
        while rest and objects[rest[0]] is not each.obj:
            rest.pop(0)
        kept.append(rest.pop(0))
    return tuple(kept)


def _tried(view: View, chosen: Chosen, run: Attempt) -> Tried:
    motion, clip = run.motion, None
    if motion is not None:
        clip = Clip(motion.times, view.present, motion.object_poses, motion.links, motion.link_poses)
    taken = None if run.taken is None else view.present[run.taken]
    success = run.outcome == SUCCESS
    its = chosen.grasp_type, chosen.T_world_tcp, chosen.probability
    return Tried(view, *its, success, run.cause, taken, str(run.touched or ""), clip)


def _view(present: Sequence[int], placed: Sequence[Placed], sensed: Sensed) -> View:
    points = np.concatenate([sensed.scene.texlets.positions.numpy(), sensed.scene.obstacles.numpy()])
    cameras = np.stack([view.camera.T_object_camera for view in sensed.views])
    return View(tuple(present), np.stack([each.T_world_object for each in placed]), points.astype(np.float32), cameras)


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    """What `work` returns, and its seconds of the processor."""
    start = time.process_time()
    return work(), time.process_time() - start
