"""One network trained to its end, or on from where a call that was killed had come to."""

from __future__ import annotations

import csv
import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lightning.fabric.plugins.io.torch_io import TorchCheckpointIO
from lightning.pytorch import Trainer
from lightning.pytorch.callbacks import EarlyStopping, ModelCheckpoint
from lightning.pytorch.loggers import CSVLogger, Logger, TensorBoardLogger
from lightning.pytorch.plugins.environments import LightningEnvironment

from spgf_torch.baselines.checkpoints import AGAIN, read_checkpoint, write_checkpoint
from spgf_torch.baselines.lightning_module import LOSS, GraspClassifier
from spgf_torch.extras import installed
from spgf_torch.files.digests import is_sealed
from spgf_torch.files.reading import unreadable

LAST, BEST, LOGS, CSV = "last.ckpt", "best.ckpt", "logs", "csv"

# About a class of torch's that Lightning 2.6 uses, and about files that are meant to be there after a resumption.
EXPECTED_WARNINGS = (
    r"`isinstance\(treespec, LeafSpec\)` is deprecated",
    r"Experiment logs directory .* exists and is not empty",
    r"Checkpoint directory .* exists and is not empty",
)


class WholeCheckpoints(TorchCheckpointIO):
    """Checkpoints that are there as a whole or not at all, whenever the process is killed."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: Any, storage_options: Any | None = None) -> None:
        write_checkpoint(Path(path), checkpoint)


def fit(make: Callable[[], GraspClassifier], folder: Path) -> GraspClassifier:
    """The module as it was at its best epoch.

    `folder` keeps `last.ckpt` and `best.ckpt` after every epoch, and `logs`. It goes on from there if they are of the
    same provenance; others are overwritten.

    Args:
        make: a module that has learned nothing, the same at every call.
    """
    with _quiet():
        module = make()
        resumed = _of_provenance(folder / LAST, module.provenance) if (folder / BEST).is_file() else None
        if resumed is None or not _finished(resumed, module):
            trainer = _trainer(module, folder, resumed)
            trainer.fit(module, ckpt_path=folder / LAST if resumed else None, weights_only=True)
        else:
            module.seconds = float(resumed["seconds"])
    best = read_checkpoint(folder / BEST, module.task.samples.cloud.device)
    try:
        module.load_state_dict(best["state_dict"])
    except (KeyError, TypeError, RuntimeError) as error:
        raise unreadable(folder / BEST, "this network at its best epoch", error, f"another one; {AGAIN}") from None
    return module.to(module.task.samples.cloud.device).eval()


def _trainer(module: GraspClassifier, folder: Path, resumed: dict[str, Any] | None) -> Trainer:
    device = module.task.samples.cloud.device
    loggers: list[Logger] = [_csv(folder, resumed)]
    if installed("tensorboard"):
        loggers.append(TensorBoardLogger(folder, name=LOGS, version="tensorboard"))
    learning = module.task.learning
    return Trainer(
        accelerator="gpu" if device.type == "cuda" else device.type,
        devices=1 if device.index is None else [device.index],
        max_epochs=learning.epochs,
        reload_dataloaders_every_n_epochs=1,
        num_sanity_val_steps=0,
        log_every_n_steps=1,  # what is logged is logged an epoch
        logger=loggers,
        callbacks=[
            EarlyStopping(LOSS, patience=learning.patience),
            ModelCheckpoint(folder, "best", LOSS, save_last=True, enable_version_counter=False),
        ],
        enable_model_summary=False,
        enable_progress_bar=False,
        plugins=[LightningEnvironment(), WholeCheckpoints()],  # one process, also where a cluster's variables are set
    )


def _csv(folder: Path, resumed: dict[str, Any] | None) -> CSVLogger:
    """The table of losses; it keeps the epochs that are not done again (Lightning would begin a new one)."""
    path = folder / LOGS / CSV / "metrics.csv"
    known: list[dict[str, str]] = []
    if resumed is not None and path.is_file():
        with path.open(newline="") as file:
            known = [row for row in csv.DictReader(file) if int(row["epoch"]) <= int(resumed["epoch"])]
    logger = CSVLogger(folder, name=LOGS, version=CSV, flush_logs_every_n_steps=1)
    logger.experiment.metrics.extend({key: value for key, value in row.items() if value} for row in known)
    logger.save()
    return logger


def _of_provenance(path: Path, provenance: str) -> dict[str, Any] | None:
    """The checkpoint, if it is there, has its seal, and is of this provenance; InputError for one that is damaged."""
    if not path.is_file() or not is_sealed(path):
        return None
    found = read_checkpoint(path)
    return found if isinstance(found, dict) and found.get("origin") == provenance else None


def _finished(checkpoint: dict[str, Any], module: GraspClassifier) -> bool:
    """Whether it was killed behind the last epoch: Lightning would go on for another one."""
    states = [state for name, state in checkpoint["callbacks"].items() if name.startswith(EarlyStopping.__name__)]
    stopped = any(state["wait_count"] >= state["patience"] for state in states)
    return stopped or int(checkpoint["epoch"]) + 1 >= module.task.learning.epochs


@contextmanager
def _quiet() -> Iterator[None]:
    """Without Lightning's notes on hardware and tips, and without the warnings that are expected."""
    logger = logging.getLogger("lightning.pytorch")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        with warnings.catch_warnings():
            for message in EXPECTED_WARNINGS:
                warnings.filterwarnings("ignore", message=message)
            yield
    finally:
        logger.setLevel(level)
