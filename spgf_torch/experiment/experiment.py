"""The experiment of the paper (section 4): predictions on every object as a novel one, and a model of all objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.calibration import Calibration
from spgf_torch.affordance.model import GraspModel
from spgf_torch.affordance.ranking import GraspScores
from spgf_torch.cache import Cache
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.cross_validation import CrossValidation, calibrate
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.learning import PrototypeFit, learn_model, side_by_side
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import ProgressReporter
from spgf_torch.prototypes.constellations import constellations
from spgf_torch.prototypes.kmeans import assign
from spgf_torch.settings import plain


@dataclass(frozen=True)
class Design:
    """Which objects teach and which are novel.

    Attributes:
        fold: (objects,) int, the fold in which each object is novel.
        order: (objects,) int, the order in which objects are taken where not all may teach.
        limit: how many objects may teach.
        part: (objects,) int, within which alone objects learn from one another, and folds are; None: all from all.
    """

    fold: np.ndarray
    order: np.ndarray
    limit: int
    part: np.ndarray | None = None

    @property
    def tests(self) -> list[int]:
        """The folds, each of which is novel once."""
        return np.unique(self.fold).tolist()

    def novel(self, test: int) -> list[int]:
        """Objects of the fold `test`."""
        return np.flatnonzero(self.fold == test).tolist()

    def training(self, test: int | None) -> list[int]:
        """Objects that teach what is used on the fold `test` (None: of all folds), in their own order."""
        allowed = [i for i in self.order.tolist() if self.fold[i] != test]
        if self.part is not None and test is not None:
            part = self.part[self.novel(test)[0]]
            allowed = [i for i in allowed if self.part[i] == part]
        return sorted(allowed[: self.limit])

    def groups(self, test: int) -> list[list[int]]:
        """The same by fold; a single fold in two halves, so that one can be held out."""
        train = self.training(test)
        groups = [[i for i in train if self.fold[i] == f] for f in self.tests]
        groups = [group for group in groups if group]
        return groups if len(groups) > 1 else [train[::2], train[1::2]]


def teaching(examples: Sequence[DescribedObject], config: TrainConfig) -> list[Tensor]:
    """Of each object those of its grasps that may teach: indices (C,) int64, ascending."""
    generator = torch.Generator().manual_seed(config.seed)
    return [example.sample_of_each_type(config.trials_per_object, generator) for example in examples]


@dataclass(frozen=True)
class Learned:
    """What an experiment leaves.

    Attributes:
        scores: of the grasps on every object, by a model that has not seen it.
        model: of all objects, if `final_model`; its calibration comes from the predictions on novel objects.
        of_fold: fold -> the model that has not seen its objects, if `fold_models`; calibrated on its training folds.
    """

    scores: list[GraspScores]
    model: GraspModel | None
    of_fold: dict[int, GraspModel]


@dataclass(frozen=True)
class Experiment:
    """Examples, which of them teach what, and how.

    Attributes:
        objects: all of them.
        examples: of every object, with all its grasps: what is predicted on.
        teach: of every object, with the grasps that teach.
        given: fold -> prototypes (K, D) of another model; None: they are learned here.
    """

    config: TrainConfig
    design: Design
    objects: Sequence[GraspObject]
    examples: Sequence[DescribedObject]
    teach: Sequence[DescribedObject]
    fit: PrototypeFit
    given: Callable[[int | None], Tensor] | None = None

    @staticmethod
    def of(
        config: TrainConfig,
        design: Design,
        objects: Sequence[GraspObject],
        examples: Sequence[DescribedObject],
        cache: Cache,
        given: Callable[[int | None], Tensor] | None = None,
    ) -> Experiment:
        """The experiment that the settings describe."""
        teach = [e.of_grasps(which) for e, which in zip(examples, teaching(examples, config), strict=True)]
        prototypes = replace(config.prototypes, num_clusters=config.K)
        return Experiment(config, design, objects, examples, teach, PrototypeFit(prototypes, config.seed, cache), given)

    def run(self, stages: ProgressReporter) -> Learned:
        """Predictions on every object by a model that has not seen it, and the models that the settings ask for."""
        tests: list[int | None] = [*self.design.tests, *([None] if self.config.final_model else [])]
        with stages.stage("prototypes", len(tests), "sets") as advance:
            centres = side_by_side(self.prototypes, tests, advance)
        scores: dict[int, GraspScores] = {}
        models: dict[int | None, GraspModel] = {}

        def work(learned: tuple[int | None, Tensor]) -> None:
            test, prototypes = learned
            if test is not None and self.config.constellations.words:
                words = self.in_words(prototypes)
                scores.update(words.predict(test, words.fit(words.relations(test)))[0])
                return
            if test is None:
                models[None] = self.model(None, prototypes)
                return
            on_novel, calibration = self.predict(test, prototypes)
            scores.update(on_novel)
            if self.config.fold_models:
                models[test] = replace(self.model(test, prototypes), calibration=calibration)

        with stages.stage("voting", len(tests), "folds and models" if None in tests else "folds") as advance:
            side_by_side(work, zip(tests, centres, strict=True), advance)
        each = [scores[i] for i in range(len(self.examples))]
        if None in models:
            held_out = calibrate(each, [e.outcomes for e in self.examples])
            models[None] = replace(models[None], calibration=held_out)
        return Learned(each, models.pop(None, None), models)  # type: ignore[arg-type]

    def in_words(self, prototypes: Tensor) -> Experiment:
        """The same with constellations of these prototypes (K, D) as relations, of which words are to be fitted."""
        asked, K = self.config.constellations, len(prototypes)
        vectors = [
            constellations(assign(each.relations, prototypes), K, each.around, asked)
            for each in self.examples
            if each.around is not None
        ]
        examples, teach = (
            [replace(each, relations=x) for each, x in zip(objects, vectors, strict=True)]
            for objects in (self.examples, self.teach)
        )
        fit = replace(self.fit, config=replace(self.fit.config, num_clusters=asked.words))
        return replace(self, examples=examples, teach=teach, fit=fit)

    def prototypes(self, test: int | None) -> Tensor:
        """The prototypes (K, D) for the fold `test` (None: for all objects)."""
        return self.fit(self.relations(test)) if self.given is None else self.given(test)

    def relations(self, test: int | None) -> Tensor:
        """(L, D) relations of all features that teach what is used on the fold `test` (None: of all folds)."""
        return torch.cat([self.teach[i].relations for i in self.design.training(test)])

    def predict(self, test: int, centres: Tensor) -> tuple[dict[int, GraspScores], Calibration]:
        """Predictions on the objects of the fold `test`, by their number, and the training folds' calibration."""
        config, novel = self.config, self.design.novel(test)
        validation = CrossValidation(config.affordance, config.inner_grasps, config.N, config.seed)
        groups = [[self.teach[i] for i in group] for group in self.design.groups(test)]
        scores, calibration = validation.predict(groups, centres, [self.examples[i] for i in novel])
        return dict(zip(novel, scores, strict=True)), calibration

    def model(self, test: int | None, centres: Tensor) -> GraspModel:
        """The model for the objects of the fold `test` (None: of all objects), not yet calibrated."""
        taught = [self.teach[i] for i in self.design.training(test)]
        digests = {self.objects[i].name: self.objects[i].digest for i in self.design.training(test)}
        settings = {**plain(self.config), "taught": digests}
        return replace(learn_model(taught, centres, self.config.affordance), settings=settings)
