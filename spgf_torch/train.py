"""`python -m spgf_torch.train +K=20`: the experiment of the paper, and a model learned on all objects.

`ranking=judge` has candidates ranked by a learned judge, too (`judging.candidates`), cross-validated like the votes.

`hand=panda judge=learn` is all that a new hand takes: random trials, votes, rounds of own trials, a judge.

What it does is in `training.run`; in a program, `spgf_torch.train(...)` does the same.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from spgf_torch.cli.command import run_command
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.progress import ProgressReporter, show
from spgf_torch.training.run import run as run_training

if TYPE_CHECKING:
    from spgf_torch.predictor import Predictor


def run(config: TrainConfig, folder: Path) -> None:
    """As `training.run`, told to a person at a terminal."""
    run_training(config, folder, ProgressReporter(), show)


class _Callable(ModuleType):
    """A module that, once imported, takes the place of the function `spgf_torch.train` in the package, and is it."""

    def __call__(self, *args: Any, **settings: Any) -> Predictor:
        from spgf_torch.training.api import train

        return train(*args, **settings)


sys.modules[__name__].__class__ = _Callable

if __name__ == "__main__":
    run_command("train", TrainConfig, run)
