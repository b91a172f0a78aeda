"""Calls of a generation, as `simulate` makes them, for tests."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toys import WORDS, checksum

from spgf_torch.settings import plain, settings
from spgf_torch.simulation.allotment import open_hand
from spgf_torch.simulation.config import SamplerConfig
from spgf_torch.simulation.executors import Executor
from spgf_torch.simulation.generation import Generation, Plan, finished, keep
from spgf_torch.simulation.run_state import RunState
from spgf_torch.simulation.table import Provenance
from spgf_torch.simulation.worker import TrialFunction, physics


@dataclass
class Calls:
    """Calls with the same objects and settings.

    Attributes:
        objects: what is tried.
        trials: hand and episode; toys have none to speak of.
        attempt: what one is; None = physics.
        candidates: of each type.
        budget: by which they are allotted, if any.
    """

    objects: Sequence[Any]
    trials: Any
    attempt: Callable[..., TrialFunction] | None
    candidates: int
    budget: int | None = None

    @property
    def made_with(self) -> dict[str, Any]:
        return {
            "hand_digest": self.trials.hand.digest,
            "sampler": plain(settings(SamplerConfig)),
            "episode": {"dt": 0.002},
            "candidates": self.candidates,
            "seed": 0,
            **({} if self.budget is None else {"budget": self.budget}),
        }

    def provenance(self, obj: Any, **changes: Any) -> Provenance:
        return Provenance(obj.name, obj.digest, **{**self.made_with, **changes})

    def make(
        self,
        out: Path,
        executor: Executor,
        chunk: int = 5,
        failed_as: str | None = None,
        versions: str = "1",
        progress: Callable[[int], None] = lambda done: None,
    ) -> tuple[RunState, int]:
        """One call; its run_state and how many trials it ran."""
        provenances = [self.provenance(obj) for obj in self.objects]
        run_state = RunState(
            out, (1, 1), {**self.made_with, "versions": {"physics": versions}}, len(self.trials.grasp_types)
        )
        there = finished(out, provenances, self.trials.grasp_types)
        with run_state.open(provenances):
            for its in there:
                keep(run_state, its)
            geometry = open_hand if self.attempt is None else tossed_collision
            plan = Plan(self.trials, chunk, failed_as, self.attempt or physics, geometry)
            generation = Generation(run_state, plan, progress)
            waiting = [pair for pair in zip(self.objects, provenances, strict=True) if pair[1] not in there]
            generation.run(waiting, executor)
        return run_state, generation.trials


def tossed_collision(obj: Any, trials: Any, grasp_type: str) -> Callable[..., bool]:
    """What geometry tells of a toy (`toys.toss`): whether it would collide."""
    return lambda T: WORDS[checksum(T) % len(WORDS)] == "collision"


def tables(out: Path) -> dict[str, bytes]:
    """Every table's bytes."""
    return {path.name: path.read_bytes() for path in sorted(out.glob("*.parquet"))}


def manifest(out: Path) -> dict[str, Any]:
    return json.loads((out / "manifest.json").read_text())
