"""The experiment of the paper (section 4): predictions on every object as a novel one, and a model of all objects."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol, TypeVar

import torch
from torch import Tensor

from spgf_torch.affordance.calibration import Calibration
from spgf_torch.affordance.model import GraspModel
from spgf_torch.affordance.ranking import GraspScores
from spgf_torch.cache import Cache
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.cross_validation import calibrate, calibrated_elsewhere, choose
from spgf_torch.experiment.described_object import DescribedObject, Made
from spgf_torch.experiment.design import Design
from spgf_torch.experiment.learning import PrototypeFit, learn_model, side_by_side
from spgf_torch.experiment.named import Identity, Named, named
from spgf_torch.experiment.training_space import TrainingSpace
from spgf_torch.progress import ProgressReporter
from spgf_torch.prototypes.constellations import constellations
from spgf_torch.prototypes.kmeans import assign
from spgf_torch.settings import plain

R = TypeVar("R")


def teaching(examples: Sequence[DescribedObject], config: TrainConfig) -> list[Tensor]:
    """Of each object those of its grasps that may teach: indices (C,) int64, ascending."""
    generator = torch.Generator().manual_seed(config.seed)
    return [example.sample_of_each_type(config.trials_per_object, generator) for example in examples]


def _of_grasps(objects: Sequence[DescribedObject], chosen: Sequence[Tensor], number: int) -> DescribedObject:
    return objects[number].of_grasps(chosen[number])


class Workers(Protocol):
    """Where sets of objects are learned, if not here (`cluster.Cluster`)."""

    def knowing(self, experiment: Experiment) -> Callable[..., list[Any]]:
        """A function that has methods of an experiment called there, as `Experiment._here` calls them here."""


@dataclass(frozen=True)
class Learned:
    """What an experiment leaves.

    Attributes:
        scores: of the grasps on every object, by a model that has not seen it; none without folds.
        model: of all objects, if `final_model`; its calibration comes from the predictions on novel objects, without
            folds from objects that were held out one by one, of a single object from nothing (`uncalibrated`).
        of_fold: fold -> the model that has not seen its objects, if `fold_models`; calibrated on its training folds.
    """

    scores: list[GraspScores]
    model: GraspModel | None
    of_fold: dict[int, GraspModel]


@dataclass(frozen=True)
class Experiment:
    """Examples, which of them teach what, and how.

    Attributes:
        objects: what all of them are called.
        examples: of every object, with all its grasps: what is predicted on.
        teach: of every object, with the grasps that teach.
        sampled: of every object, with those of them that calibrate and choose rankings: a random sample, to save time.
        given: fold -> prototypes (K, D) of another model; None: they are learned here.
    """

    config: TrainConfig
    design: Design
    objects: Sequence[Named]
    examples: Sequence[DescribedObject]
    teach: Sequence[DescribedObject]
    sampled: Sequence[DescribedObject]
    fit: PrototypeFit
    given: Callable[[int | None], Tensor] | None = None

    @staticmethod
    def of(
        config: TrainConfig,
        design: Design,
        objects: Sequence[Identity],
        examples: Sequence[DescribedObject],
        cache: Cache,
        given: Callable[[int | None], Tensor] | None = None,
    ) -> Experiment:
        """The experiment that the settings describe."""
        which, every = teaching(examples, config), range(len(examples))
        teach = Made(partial(_of_grasps, examples, which), every)
        generator = torch.Generator().manual_seed(config.seed)
        some = [each.sample(config.inner_grasps, generator) for each in teach]
        sampled = Made(partial(_of_grasps, teach, some), every)
        fit = PrototypeFit(replace(config.prototypes, num_clusters=config.K), config.seed, cache)
        return Experiment(config, design, named(objects), examples, teach, sampled, fit, given)

    def run(self, stages: ProgressReporter, cluster: Workers | None = None) -> Learned:
        """Predictions on every object by a model that has not seen it, and the models that the settings ask for.

        Each set of objects that teach is learned by itself: here, two side by side, or on the workers of a cluster.
        """
        each = self._here if cluster is None else cluster.knowing(self)
        tests: list[int | None] = [*self.design.tests, *([None] if self.config.final_model else [])]
        inner = self.design.inner_folds() if self.shares else {}
        with stages.stage("prototypes", len(inner) + len(tests), "sets") as advance:
            centres = each(Experiment.prototypes, [(which,) for which in [*inner, *tests]], advance)
        held_out: dict[tuple[int | None, int], GraspScores] = {}
        with stages.stage("voting", len(centres), "folds and models" if None in tests else "folds") as advance:
            asked = [(*row, inner[row[0]]) for row in zip(inner, centres, strict=False)]
            for found in each(Experiment.predict_inside, asked, advance):
                held_out.update(found)
            chosen = self._chosen(held_out) if self.shares else {}
            work = [(t, c, chosen.get(t)) for t, c in zip(tests, centres[len(inner) :], strict=True)]
            folds = dict(zip(tests, each(Experiment.fold, work, advance), strict=True))
        scores = {i: own for on_novel, _ in folds.values() for i, own in on_novel.items()}
        models = {test: model for test, (_, model) in folds.items() if model is not None}
        in_order = [scores[i] for i in range(len(self.examples))] if self.design.tests else []
        if None in models and in_order:
            calibration = calibrate(in_order, [e.outcomes for e in self.examples], self.design.fold.tolist())
            models[None] = replace(models[None], calibration=calibration)
        return Learned(in_order, models.pop(None, None), models)  # type: ignore[arg-type]

    def _here(
        self, work: Callable[..., R], items: Sequence[tuple[Any, ...]], advance: Callable[[int], None]
    ) -> list[R]:
        return side_by_side(lambda item: work(self, *item), items, advance)

    def _chosen(
        self, held_out: Mapping[tuple[int | None, int], GraspScores]
    ) -> dict[int | None, tuple[Calibration, str]]:
        found = self._here(Experiment.nested, [(test, held_out) for test in self.design.asking], lambda _: None)
        return dict(zip(self.design.asking, found, strict=True))

    def fold(
        self, test: int | None, prototypes: Tensor, chosen: tuple[Calibration, str] | None
    ) -> tuple[dict[int, GraspScores], GraspModel | None]:
        """Predictions on the objects of the fold `test`, and its model if it is kept; None: the model of all.

        chosen: calibration and ranking as `nested` finds them, where test folds share inner folds.
        """
        if test is None:
            model = self.model(None, prototypes)
            if test not in self.design.asking:
                return {}, model
            its = chosen or self.chosen_alone(test, prototypes)
            return {}, replace(model, calibration=its[0])
        if self.config.constellations.words:
            words = self.in_words(prototypes)
            return words.predict_alone(test, words.prototypes(tuple(self.design.training(test))))[0], None
        if chosen is None:
            on_novel, calibration = self.predict_alone(test, prototypes)
        else:
            on_novel, calibration = self.predict(test, prototypes, chosen), chosen[0]
        kept = self.config.fold_models
        return on_novel, replace(self.model(test, prototypes), calibration=calibration) if kept else None

    def in_words(self, prototypes: Tensor) -> Experiment:
        """The same with constellations of these prototypes (K, D) as relations, of which words are to be fitted."""
        asked, K = self.config.constellations, len(prototypes)
        vectors = [
            constellations(assign(each.relations, prototypes), K, each.around, asked)
            for each in self.examples
            if each.around is not None
        ]
        examples, teach, sampled = (
            [replace(each, relations=x) for each, x in zip(objects, vectors, strict=True)]
            for objects in (self.examples, self.teach, self.sampled)
        )
        fit = replace(self.fit, config=replace(self.fit.config, num_clusters=asked.words))
        return replace(self, examples=examples, teach=teach, sampled=sampled, fit=fit, given=None)

    @property
    def shares(self) -> bool:
        """Whether test folds share what inner folds learn: not where prototypes, or words of them, are a fold's."""
        return self.given is None and not self.config.constellations.words

    def prototypes(self, which: tuple[int, ...] | int | None) -> Tensor:
        """The prototypes (K, D) of objects, or for the fold of this number (None: for all objects)."""
        if isinstance(which, tuple):
            return self.fit(self.relations(which))
        return self.fit(self.relations(self.design.training(which))) if self.given is None else self.given(which)

    def relations(self, objects: Sequence[int]) -> Tensor:
        """(L, D) relations of all features of the objects."""
        return torch.cat([self.examples[i].relations for i in objects])

    def predict_alone(self, test: int, centres: Tensor) -> tuple[dict[int, GraspScores], Calibration]:
        """As `predict`, by inner folds that serve the fold `test` alone, and what these calibrate."""
        chosen = self.chosen_alone(test, centres)
        return self.predict(test, centres, chosen), chosen[0]

    def chosen_alone(self, test: int | None, centres: Tensor) -> tuple[Calibration, str]:
        """As `nested`, by inner folds that serve the fold `test` alone. Given prototypes are theirs, too."""
        held_out: dict[tuple[int | None, int], GraspScores] = {}
        for group in self.design.groups(test):
            taught = tuple(i for i in self.design.training(test) if i not in group)
            inside = centres if self.given is not None else self.prototypes(taught)
            held_out |= self.predict_inside(taught, inside, [(test, i) for i in group])
        return self.nested(test, held_out)

    def predict_inside(
        self, taught: Sequence[int], centres: Tensor, held_out: Sequence[tuple[int | None, int]]
    ) -> dict[tuple[int | None, int], GraspScores]:
        """What some training objects say of the sampled grasps on those held out; see `Design.inner_folds`."""
        space = TrainingSpace(Made(self.teach.__getitem__, taught), centres, self.config.affordance)
        asking = Made(self.sampled.__getitem__, [i for _, i in held_out])
        return dict(zip(held_out, space.score_grasps(asking), strict=True))

    def predict(self, test: int, centres: Tensor, chosen: tuple[Calibration, str]) -> dict[int, GraspScores]:
        """Predictions on the objects of the fold `test`, given calibration and ranking of the training folds."""
        novel = self.design.novel(test)
        taught = Made(self.teach.__getitem__, self.design.training(test))
        scores = TrainingSpace(taught, centres, self.config.affordance).score_grasps([self.examples[i] for i in novel])
        calibration, ranking = chosen
        ranked = [each.calibrated(calibration).with_chosen(ranking) for each in scores]
        return dict(zip(novel, ranked, strict=True))

    def nested(
        self, test: int | None, held_out: Mapping[tuple[int | None, int], GraspScores]
    ) -> tuple[Calibration, str]:
        """Calibration and choice of the ranking for the fold `test`, on training objects that were held out.

        Of the sampled grasps the same share counts as best as N is of all that teach.
        """
        group = {i: g for g, members in enumerate(self.design.groups(test)) for i in members}
        scores, success = [held_out[test, i] for i in group], [self.sampled[i].outcomes for i in group]
        groups = list(group.values())
        share = sum(map(len, success)) / sum(len(self.teach[i]) for i in group)
        chosen = choose(calibrated_elsewhere(scores, success, groups), success, math.ceil(self.config.N * share))
        return calibrate(scores, success, groups), chosen

    def model(self, test: int | None, centres: Tensor) -> GraspModel:
        """The model for the objects of the fold `test` (None: of all objects), not yet calibrated."""
        taught = Made(self.teach.__getitem__, self.design.training(test))
        digests = {self.objects[i].name: self.objects[i].digest for i in self.design.training(test)}
        settings = {**plain(self.config), "taught": digests}
        return replace(learn_model(taught, centres, self.config.affordance), settings=settings)
