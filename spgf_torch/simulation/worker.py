"""The work of one process: run the trials of a chunk of candidates on one object; repeat a chunk whose process died.

Does not import torch, which no trial needs: a worker starts in two seconds and takes a third of the memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from spgf_torch.simulation.config import samplers_of
from spgf_torch.simulation.worker_process import WorkerDiedError, WorkerProcess, limited

if TYPE_CHECKING:
    from spgf_torch.hands.hand import Hand
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.simulation.config import EpisodeConfig

# Loading an object may take so many times the time limit of a trial: the first one loads the simulator.
BUILDING = 10

# T_object_tcp (4, 4) -> how it ended, a word of `label.Label`: one of `table.OUTCOMES` alone, or with a cause.
TrialFunction = Callable[[np.ndarray], str]
# Object, trials and grasp type -> its trial: a function, or settings that can be called and whose `repr` tells all.
TrialMaker = Callable[["GraspObject", "Trials", str], TrialFunction]


@dataclass(frozen=True)
class Trials:
    """Settings of trials: the hand and the episode."""

    hand: Hand
    episode: EpisodeConfig

    @property
    def samplers(self) -> dict[str, str]:
        """Grasp type -> the sampler of its candidates, in the order of the types' codes."""
        return samplers_of(self.hand.config)

    @property
    def grasp_types(self) -> tuple[str, ...]:
        """Names of the hand's grasp types."""
        return tuple(self.samplers)


def physics(obj: GraspObject, trials: Trials, grasp_type: str) -> TrialFunction:
    """Return the trial on an object: a pre-check of collisions, then the episode in SAPIEN."""
    from spgf_torch.simulation.episode import Simulator  # SAPIEN is loaded in workers only
    from spgf_torch.simulation.precheck import PreCheck
    from spgf_torch.simulation.robot import RobotTrials

    if trials.episode.robot is not None:
        robot = RobotTrials(obj, trials.hand, trials.episode, grasp_type)
        return lambda T: robot.run(T).word
    check = PreCheck(obj, trials.hand.preshapes[grasp_type])
    simulator = Simulator(obj, trials.hand, trials.episode)
    return lambda T: "collision" if check.collides(T) else simulator.run(T, grasp_type)


@dataclass(frozen=True)
class Case:
    """One object and grasp type, and how its trials run; `key` represents all fields that are not compared."""

    key: str
    grasp_type: str
    obj: GraspObject = field(compare=False)
    trials: Trials = field(compare=False)
    make: TrialMaker = field(default=physics, compare=False)

    @staticmethod
    def of(
        obj: GraspObject,
        trials: Trials,
        grasp_type: str,
        make: TrialMaker = physics,
    ) -> Case:
        name = getattr(make, "__qualname__", repr(make))
        return Case(f"{obj.digest} {trials.hand.digest} {trials.episode} {name}", grasp_type, obj, trials, make)


@dataclass(frozen=True)
class ChunkResult:
    """The result of a chunk.

    Attributes:
        outcomes: of each candidate how it ended (`TrialFunction`), or None where it has none.
        reasons: index into `outcomes` -> why it has none.
        unbuilt: why the object could not be loaded, or ""; then no candidate has an outcome.
        incident: a failure that was repaired or is among `reasons`, or "".
    """

    outcomes: list[str | None]
    reasons: dict[int, str] = field(default_factory=dict)
    unbuilt: str = ""
    incident: str = ""


def try_chunk(case: Case, T_object_tcp: np.ndarray, limit: float | None = None) -> ChunkResult:
    """Run the trial of each T_object_tcp (M, 4, 4) in this process, which ends if one exceeds `limit` seconds."""
    try:
        with limited(limit and BUILDING * limit):
            run_trial = _trial_function(case)
    except Exception as error:  # a failure of one object must not stop the others
        return ChunkResult([None] * len(T_object_tcp), unbuilt=error_line(error))
    outcomes: list[str | None] = []
    reasons: dict[int, str] = {}
    for index, T in enumerate(T_object_tcp):
        try:
            with limited(limit):
                outcomes.append(run_trial(T))
        except Exception as error:
            outcomes.append(None)
            reasons[index] = error_line(error)
    return ChunkResult(outcomes, reasons)


def try_in_process(
    process: WorkerProcess, case: Case, T_object_tcp: np.ndarray, limit: float | None = None
) -> ChunkResult:
    """Run `try_chunk` in a separate process.

    If that process dies, the candidates are tried again one by one, each once. No trial depends on another, so that
    those that end have the same outcome.
    """
    try:
        return process.call(try_chunk, case, T_object_tcp, limit)
    except WorkerDiedError as died:
        incident = (
            f"{case.obj.name} {case.grasp_type}: a process died ({died}); {len(T_object_tcp)} candidates tried again"
        )
    outcomes: list[str | None] = []
    reasons: dict[int, str] = {}
    for index in range(-1, len(T_object_tcp)):  # first without a candidate: only the object is loaded
        try:
            one = process.call(try_chunk, case, T_object_tcp[max(index, 0) : index + 1], limit)
        except WorkerDiedError as died:
            one = ChunkResult([None], {0: _overdue(limit) if died.overdue else str(died)})
            if index < 0:
                one = ChunkResult([], unbuilt=one.reasons[0])
        if one.unbuilt:
            return ChunkResult([None] * len(T_object_tcp), unbuilt=one.unbuilt, incident=incident)
        outcomes += one.outcomes
        if one.reasons:
            reasons[index] = one.reasons[0]
    return ChunkResult(outcomes, reasons, incident=incident)


@lru_cache(maxsize=2)
def _trial_function(case: Case) -> TrialFunction:
    """Load an object, and keep it in the worker for the following chunks."""
    return case.make(case.obj, case.trials, case.grasp_type)


def _overdue(limit: float | None) -> str:
    return f"did not end within {limit:g} s"


def error_line(error: Exception) -> str:
    """Return type and first line of an error."""
    lines = str(error).splitlines()
    return f"{type(error).__name__}: {lines[0][:200]}" if lines else type(error).__name__
