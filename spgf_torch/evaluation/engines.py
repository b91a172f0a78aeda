"""The same grasps in two engines: what each holds, what both hold, and where they disagree."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spgf_torch.evaluation.success import ALL, Rates, bootstrap_interval, class_means
from spgf_torch.experiment.config import EvaluateConfig
from spgf_torch.experiment.describe import Grasps
from spgf_torch.experiment.execution import SUCCESS, Executed
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.second_engine.physics import MUJOCO, SAPIEN
from spgf_torch.simulation.table import OUTCOMES

BOTH = "both"
COLLISION = OUTCOMES.index("collision")  # of the pre-check, which both engines share
POSE = ("x", "y", "z", "xx", "xy", "xz", "zx", "zy", "zz")  # of the TCP, m; its closing and approach axes


@dataclass(frozen=True)
class Compared:
    """One object's executed grasps in both engines.

    Attributes:
        which: (M,) int64, indices of the grasps that were executed.
        outcomes: engine -> (M,) int64 codes into `OUTCOMES`.
        grasp_type: (M,) int64, index into the hand's types. T_object_tcp: (M, 4, 4).
        best: grasp type or CG -> places (<= N,) among the M, best first. random: (R,) places of the random sample.
    """

    name: str
    category: str
    which: np.ndarray
    outcomes: dict[str, np.ndarray]
    grasp_type: np.ndarray
    T_object_tcp: np.ndarray
    best: dict[str, np.ndarray]
    random: np.ndarray

    @staticmethod
    def of(obj: GraspObject, grasps: Grasps, executed: Mapping[str, Executed]) -> Compared:
        """What both engines made of an object's grasps."""
        first = executed[SAPIEN]
        which = first.ran.nonzero()[:, 0].numpy()
        best = {name: np.searchsorted(which, chosen.numpy()) for name, chosen in first.best.items()}
        random = [chosen.numpy() for chosen in first.random.values()]
        return Compared(
            obj.name,
            obj.category,
            which,
            {engine: its.outcome.numpy()[which] for engine, its in executed.items()},
            grasps.grasp_type.numpy()[which],
            grasps.T_object_tcp.double().numpy()[which],
            best,
            np.searchsorted(which, np.concatenate(random)),
        )

    @property
    def held(self) -> dict[str, np.ndarray]:
        """(M,) bool of each engine and of both."""
        held = {engine: codes == SUCCESS for engine, codes in self.outcomes.items()}
        return {**held, BOTH: held[SAPIEN] & held[MUJOCO]}

    @property
    def agree(self) -> np.ndarray:
        """(M,) bool: held in both or in neither."""
        return np.asarray(self.held[SAPIEN] == self.held[MUJOCO])

    @property
    def free(self) -> np.ndarray:
        """(M,) bool: executed, since the open hand does not cut the object."""
        return np.asarray(self.outcomes[SAPIEN] != COLLISION)

    def rates(self, engine: str) -> Rates:
        """Of each type and CG the share of the best grasps that were held."""
        held = self.held[engine]
        return {name: float(held[places].mean()) if len(places) else 0.0 for name, places in self.best.items()}

    def disagreements(self) -> list[int]:
        """Places of the grasps that one engine holds: the best CG first, then those of the types, then random ones."""
        order = [*self.best[ALL], *(place for name, its in self.best.items() if name != ALL for place in its)]
        ranked = list(dict.fromkeys([*map(int, order), *map(int, self.random)]))
        return [place for place in ranked if not self.agree[place]]

    def rank(self, place: int) -> int | None:
        """From 1, among the best CG; None of another."""
        found = np.flatnonzero(self.best[ALL] == place)
        return int(found[0]) + 1 if len(found) else None


def engine_results(compared: Sequence[Compared], config: EvaluateConfig) -> dict[str, Any]:
    """What `results.json` holds more of two engines; rates are fractions, intervals over objects."""
    classes = [its.category for its in compared]
    found: dict[str, Any] = {}
    for engine in (SAPIEN, MUJOCO, BOTH):
        rates = [its.rates(engine) for its in compared]
        found[engine] = {
            "success_rate": class_means(classes, rates),
            "interval95": bootstrap_interval(classes, rates, config.bootstrap, config.seed),
            # Of fewer grasps than N those that are missing count as failures.
            "top_N": float(np.mean([its.held[engine][its.best[ALL]].sum() / config.N for its in compared])),
        }
    pairs = Counter(pair for its in compared for pair in zip(*its.outcomes.values(), strict=True))
    return {
        **found,
        "agreement": {
            "free": _agreement([its.agree[its.free] for its in compared], classes, config),
            "best": _agreement([its.agree[its.best[ALL]] for its in compared], classes, config),
        },
        "outcomes": [
            {SAPIEN: OUTCOMES[a], MUJOCO: OUTCOMES[b], "grasps": count}
            for (a, b), count in sorted(pairs.items(), key=lambda item: (-item[1], item[0]))
        ],
        "per_object": [
            {
                "object": its.name,
                **{engine: its.rates(engine)[ALL] for engine in (SAPIEN, MUJOCO, BOTH)},
                **_counts(its),
            }
            for its in compared
        ],
    }


def _agreement(same: Sequence[np.ndarray], classes: Sequence[str], config: EvaluateConfig) -> dict[str, Any]:
    """Mean over the objects that have such grasps of the share on which the engines agree, and its interval."""
    some = [i for i, its in enumerate(same) if len(its)]
    if not some:
        return {"grasps": 0, "share": None, "interval95": None}
    rates, of = [{ALL: float(same[i].mean())} for i in some], [classes[i] for i in some]
    return {
        "grasps": sum(map(len, same)),
        "share": class_means(of, rates)["all"][ALL],
        "interval95": bootstrap_interval(of, rates, config.bootstrap, config.seed)["all"][ALL],
    }


def _counts(its: Compared) -> dict[str, int]:
    return {"free": int(its.free.sum()), "disagree": int((~its.agree).sum())}


def engines_csv(compared: Sequence[Compared], grasp_types: Sequence[str]) -> str:
    """`engines.csv`: a row each executed grasp; its rank among the best of its type and of all, its pose, outcomes."""
    text = io.StringIO()
    head = ["object", "class", "grasp", "type", "rank", "rank_of_type", "random", *POSE, SAPIEN, MUJOCO, "agree"]
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(row for its in compared for row in _rows(its, grasp_types))
    return text.getvalue()


def _rows(its: Compared, grasp_types: Sequence[str]) -> Iterator[list[Any]]:
    of_type = {int(place): rank for name in grasp_types for rank, place in enumerate(its.best[name], start=1)}
    random = set(its.random.tolist())
    for place, T in enumerate(its.T_object_tcp):
        pose = [*T[:3, 3], *T[:3, 0], *T[:3, 2]]
        yield [
            its.name,
            its.category,
            its.which[place],
            grasp_types[its.grasp_type[place]],
            its.rank(place) or "",
            of_type.get(place, ""),
            int(place in random),
            *(f"{value:.6f}" for value in pose),
            *(OUTCOMES[its.outcomes[engine][place]] for engine in (SAPIEN, MUJOCO)),
            int(its.agree[place]),
        ]
