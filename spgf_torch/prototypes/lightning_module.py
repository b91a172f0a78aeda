"""Mini-batch k-means as a LightningModule, and the fit of the prototypes (paper, section 3.2).

Lightning counts steps and writes checkpoints only under automatic optimisation, so the module stays with it though
it has no optimizer: `configure_optimizers` and `training_step` return None, the buffers move under `no_grad`.
"""

from __future__ import annotations

import hashlib
import json
import logging
import pickle
import sys
import warnings
from contextlib import ExitStack
from pathlib import Path
from threading import Lock
from typing import Any

import torch
from lightning.fabric.plugins.environments import LightningEnvironment
from lightning.pytorch import LightningModule, Trainer
from torch import Tensor

from spgf_torch.prototypes.batches import MiniBatches, check_relations
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.prototypes.kmeans import canonical_order, lloyd, minibatch_step
from spgf_torch.prototypes.kmeans_search import initial_centres
from spgf_torch.settings import plain
from spgf_torch.threads import one_thread

CHECKPOINT = "prototypes.ckpt"

# Lightning's two warnings about a module without an optimizer, and torch's about a class that Lightning 2.6 uses.
EXPECTED_WARNINGS = (
    "`LightningModule.configure_optimizers` returned `None`",
    "`training_step` returned `None`",
    r"`isinstance\(treespec, LeafSpec\)` is deprecated",
)


class MiniBatchKMeans(LightningModule):
    """Searches a start, then moves the centres by one mini-batch a step; a checkpoint an epoch if given a path."""

    centres: Tensor  # (K, D)
    counts: Tensor  # (K,) points that each centre stands for; none before the search

    def __init__(
        self, relations: Tensor, config: PrototypeConfig, seed: int, checkpoint: Path | None = None, origin: str = ""
    ) -> None:
        super().__init__()
        self.relations, self.config, self.seed = relations, config, seed
        self.checkpoint, self.origin = checkpoint, origin
        self.register_buffer("centres", relations.new_zeros(config.num_clusters, relations.shape[1]))
        self.register_buffer("counts", relations.new_zeros(config.num_clusters))

    def configure_optimizers(self) -> None:
        return None

    def train_dataloader(self) -> MiniBatches:
        return MiniBatches(self.relations, self.config.batch_size, self.seed, self.current_epoch)

    def on_fit_start(self) -> None:
        if not self.counts.any():
            self._move(*initial_centres(self.relations, self.config, torch.Generator().manual_seed(self.seed)))

    @torch.no_grad()
    def training_step(self, batch: Tensor, batch_idx: int) -> None:
        self._move(*minibatch_step(batch, self.centres, self.counts))

    def on_train_epoch_end(self) -> None:
        if self.checkpoint is not None:
            self.trainer.save_checkpoint(self.checkpoint)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        checkpoint["origin"] = self.origin

    def _move(self, centres: Tensor, counts: Tensor) -> None:
        self.centres.copy_(centres)
        self.counts.copy_(counts)


def fit_prototypes(
    relations: Tensor, config: PrototypeConfig, seed: int, folder: Path | None = None, progress: bool = False
) -> Tensor:
    """The prototypes P_id (Eqs. 5, 6): centres (K, D) float32 of relations (L, D), commonest first.

    Search on a subsample, mini-batches over all relations, Lloyd steps to the end. The same arguments give the same
    prototypes; clusterings that are equal get equal ids whatever the seed.

    Args:
        folder: `prototypes.ckpt` is written there after every epoch, and resumed from if it was made from the same
            relations, settings and seed; any other is overwritten.
        progress: a progress bar, if the output is a terminal.

    Raises InputError where relations are not finite numbers of shape (L, D) or fewer than K of them differ.
    """
    device, relations = relations.device, relations.float().cpu().contiguous()
    check_relations(relations, config.num_clusters)
    checkpoint = None if folder is None else folder / CHECKPOINT
    origin = "" if folder is None else _origin(relations, config, seed)
    module = MiniBatchKMeans(relations, config, seed, checkpoint, origin)
    with _quiet, one_thread():
        trainer = _trainer(config.epochs, progress and sys.stdout.isatty())
        trainer.fit(module, ckpt_path=_resumable(checkpoint, origin), weights_only=True)
    centres, counts = lloyd(relations, module.centres, config.refine_steps, config.tolerance)
    return centres[canonical_order(centres, counts)].to(device)


def _trainer(epochs: int, progress: bool) -> Trainer:
    return Trainer(
        accelerator="cpu",
        devices=1,
        max_epochs=epochs,
        reload_dataloaders_every_n_epochs=1,
        num_sanity_val_steps=0,
        logger=False,
        enable_checkpointing=False,
        enable_model_summary=False,
        enable_progress_bar=progress,
        plugins=[LightningEnvironment()],  # one process, also where a cluster's variables are set
    )


class _Quiet:
    """Without Lightning's notes on hardware and tips, and without the warnings that are expected.

    Filters and log levels belong to the whole process: of fits in several threads the first one to come in sets
    them, the last one to leave puts them back.
    """

    def __init__(self) -> None:
        self.lock, self.inside, self.undo = Lock(), 0, ExitStack()

    def __enter__(self) -> None:
        with self.lock:
            self.inside += 1
            if self.inside == 1:
                logger = logging.getLogger("lightning.pytorch")
                self.undo.callback(logger.setLevel, logger.level)
                logger.setLevel(logging.WARNING)
                self.undo.enter_context(warnings.catch_warnings())
                for message in EXPECTED_WARNINGS:
                    warnings.filterwarnings("ignore", message=message)

    def __exit__(self, *error: object) -> None:
        with self.lock:
            self.inside -= 1
            if self.inside == 0:
                self.undo.close()


_quiet = _Quiet()


def _origin(relations: Tensor, config: PrototypeConfig, seed: int) -> str:
    """SHA-256 over what a fit depends on."""
    sha = hashlib.sha256(json.dumps([plain(config), seed, list(relations.shape)]).encode())
    sha.update(relations.numpy().data)
    return sha.hexdigest()


def _resumable(checkpoint: Path | None, origin: str) -> Path | None:
    """The checkpoint, if it is there, whole, and of this origin; it only saves time, so any other starts anew."""
    if checkpoint is None or not checkpoint.is_file():
        return None
    try:
        found = torch.load(checkpoint, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, EOFError, RuntimeError):
        return None
    return checkpoint if isinstance(found, dict) and found.get("origin") == origin else None
