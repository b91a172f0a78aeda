"""The network as Lightning trains it: draws, loss, optimizer, and what a checkpoint keeps."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from lightning.pytorch import LightningModule
from lightning.pytorch.utilities.types import OptimizerLRSchedulerConfig
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from spgf_torch.baselines.config import AugmentConfig, LearningConfig
from spgf_torch.baselines.pointnet import PointNet, augmented, balance, balanced_loss, grasp_logits
from spgf_torch.baselines.samples import Samples

LOSS = "inner_loss"  # what early stopping looks at


@dataclass(frozen=True)
class Task:
    """What one network learns from, and what stops it.

    Attributes:
        samples: all trials. teach (T,), inner (I,) int64: rows of them, of objects that teach and of inner ones.
        symmetric: (types,) bool, of which a mirror image along closing is as good.
        seed: of draws and augmentation; each epoch has its own stream, so that a fit can be resumed at any.
    """

    samples: Samples
    teach: Tensor
    inner: Tensor
    symmetric: Tensor
    augment: AugmentConfig
    learning: LearningConfig
    seed: int


class Draws:
    """An epoch's batches (cloud, type, success): rows drawn with replacement, as many of each type and outcome.

    With them the plain loss is class-balanced in expectation, and no time is spent on the hundredth collision. A
    plain iterable: a DataLoader would only add its collation, and a warning on machines with many cores.
    """

    def __init__(self, task: Task, epoch: int) -> None:
        self.task, self.stream = task, (task.seed, epoch)

    def __len__(self) -> int:
        return -(-self.task.learning.grasps_per_epoch // self.task.learning.batch_size)

    def __iter__(self) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
        task, known = self.task, self.task.samples
        seed = int(np.random.SeedSequence(self.stream).generate_state(1)[0])
        device = known.cloud.device
        here, there = torch.Generator().manual_seed(seed), torch.Generator(device).manual_seed(seed)
        weights = balance(known.grasp_type[task.teach].cpu(), known.success[task.teach].cpu())
        drawn = torch.multinomial(weights, task.learning.grasps_per_epoch, replacement=True, generator=here)
        for rows in task.teach[drawn].to(device).split(task.learning.batch_size):
            grasp_type = known.grasp_type[rows]
            cloud = augmented(known.cloud[rows].float(), task.symmetric.to(device)[grasp_type], task.augment, there)
            yield cloud, grasp_type, known.success[rows]


@dataclass(frozen=True)
class Whole:
    """All rows in one batch: the balance of their loss is that of all of them. (Lightning takes a list for loaders.)"""

    rows: Tensor

    def __len__(self) -> int:
        return 1

    def __iter__(self) -> Iterator[Tensor]:
        return iter([self.rows])


class GraspClassifier(LightningModule):
    """Trains a PointNet on balanced draws and watches its balanced loss on the trials of inner objects.

    `tell` is called after every epoch. `seconds` is the time of all epochs, also of those before a resumption.
    """

    def __init__(self, network: PointNet, task: Task, provenance: str, tell: Callable[[], None]) -> None:
        super().__init__()
        self.network, self.task, self.provenance, self.tell = network, task, provenance, tell
        self.seconds, self._began = 0.0, 0.0

    def train_dataloader(self) -> Draws:
        return Draws(self.task, self.current_epoch)

    def val_dataloader(self) -> Whole:
        return Whole(self.task.inner)

    def configure_optimizers(self) -> OptimizerLRSchedulerConfig:
        learning = self.task.learning
        optimizer = torch.optim.AdamW(self.parameters(), lr=learning.rate, weight_decay=learning.weight_decay)
        steps = len(self.train_dataloader()) * learning.epochs
        slower = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": slower, "interval": "step"}}

    def on_train_epoch_start(self) -> None:
        self._began = time.perf_counter()

    def training_step(self, batch: tuple[Tensor, Tensor, Tensor], batch_idx: int) -> Tensor:
        cloud, grasp_type, success = batch
        loss = binary_cross_entropy_with_logits(self.network(cloud, grasp_type), success.to(cloud.dtype))
        self.log("loss", loss, on_step=False, on_epoch=True, batch_size=len(cloud))
        return loss

    def validation_step(self, rows: Tensor, batch_idx: int) -> None:
        known = self.task.samples
        grasp_type, success = known.grasp_type[rows], known.success[rows]
        logit = grasp_logits(self.network, known.cloud[rows], grasp_type)
        self.log(LOSS, balanced_loss(logit, grasp_type, success), batch_size=len(rows))
        self.log(
            "inner_accuracy", (balance(grasp_type, success).to(logit) * ((logit > 0) == success)).sum(), batch_size=1
        )

    def on_validation_end(self) -> None:
        self.seconds += time.perf_counter() - self._began  # before the epoch's checkpoint is written
        self._began = time.perf_counter()
        self.tell()

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        checkpoint.update(origin=self.provenance, seconds=self.seconds)

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        self.seconds = float(checkpoint["seconds"])
