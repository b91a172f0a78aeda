"""Why each trial of a table ended as it did: columns beside the outcomes, of a robot's episode alone.

Columns: phase and cause (words of `label`), force (float32, N) and lost (links of the fingers), as in `label.Label`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import torch
from torch import Tensor

from spgf_torch.simulation.columns import codes_in, dictionary, floats, words_of
from spgf_torch.simulation.label import CAUSES, PHASES, Label

CAUSE_COLUMNS = ("phase", "cause", "force", "lost")


def has_causes(episode: Mapping[str, Any]) -> bool:
    """Whether trials of an episode (plain values) say why they ended."""
    return "robot" in episode


@dataclass(frozen=True)
class Causes:
    """Of M trials.

    Attributes:
        phase, cause: (M,) int64, indices into `label.PHASES` and `label.CAUSES`.
        force: (M,) float32, N, of the weakest finger that a grasp needs, at the end.
        lost: (M,) int64, index into `fingers`: those that did not touch then.
        fingers: what occurs of these, sorted.
    """

    phase: Tensor
    cause: Tensor
    force: Tensor
    lost: Tensor
    fingers: tuple[str, ...]

    @staticmethod
    def of(labels: Sequence[Label]) -> Causes:
        fingers = tuple(sorted({label.lost for label in labels}))
        return Causes(
            phase=torch.tensor([PHASES.index(label.phase) for label in labels], dtype=torch.int64),
            cause=torch.tensor([CAUSES.index(label.cause) for label in labels], dtype=torch.int64),
            force=torch.tensor([label.force for label in labels], dtype=torch.float32),
            lost=torch.tensor([fingers.index(label.lost) for label in labels], dtype=torch.int64),
            fingers=fingers,
        )

    @staticmethod
    def together(parts: Sequence[Causes]) -> Causes:
        """One after the other."""
        fingers = tuple(sorted({word for part in parts for word in part.fingers}))
        lost = [torch.tensor([fingers.index(word) for word in part.fingers])[part.lost] for part in parts]
        phase, cause, force = (
            torch.cat([getattr(part, name) for part in parts]) for name in ("phase", "cause", "force")
        )
        return Causes(phase, cause, force, torch.cat(lost), fingers)

    def at(self, which: Tensor) -> Causes:
        """Those of some trials: a mask (M,) or indices."""
        return Causes(self.phase[which], self.cause[which], self.force[which], self.lost[which], self.fingers)

    def labels(self, outcomes: Sequence[str]) -> list[Label]:
        """Of each trial, given its outcome."""
        columns = (self.phase.tolist(), self.cause.tolist(), self.force.tolist(), self.lost.tolist())
        return [
            Label(outcome, PHASES[phase], CAUSES[cause], force, self.fingers[lost])
            for outcome, phase, cause, force, lost in zip(outcomes, *columns, strict=True)
        ]

    def columns(self) -> dict[str, Any]:
        """By the names of `CAUSE_COLUMNS`."""
        words = dictionary(self.phase, PHASES), dictionary(self.cause, CAUSES)
        return dict(zip(CAUSE_COLUMNS, (*words, self.force.numpy(), dictionary(self.lost, self.fingers)), strict=True))

    @staticmethod
    def read(path: Path, content: pa.Table) -> Causes:
        """Of a table's columns. Raises InputError for other words."""
        fingers = words_of(content, "lost")
        return Causes(
            phase=codes_in(path, content, "phase", PHASES),
            cause=codes_in(path, content, "cause", CAUSES),
            force=floats(content, ("force",))[:, 0],
            lost=codes_in(path, content, "lost", fingers),
            fingers=fingers,
        )
