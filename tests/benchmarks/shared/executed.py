"""The ten best hypotheses by each set of numbers, and with those of the votes added, executed on held-out objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from shared.hidden import pieces_of
from shared.paired import words
from shared.spgf_numbers import Described, with_hands
from shared.tried_rows import Tried
from shared.votes_beside import beyond_geometry, examples, proposer_of
from spgf_torch.judging.training_rows import COLLISION, SUCCESS
from spgf_torch.proposing.hypotheses import Hypotheses
from spgf_torch.proposing.judge_features import judge_features
from spgf_torch.proposing.sampling import non_maximum_suppression
from spgf_torch.threads import in_parts

# The judge's best hypotheses of a cloud, which others rank again.
POOL = 200
BEST = 10
VOTES = "votes' hypotheses too"


@dataclass(frozen=True)
class Chosen:
    """The best of one cloud by one way, in order: poses (<= 10), by_votes (<= 10,) bool: only the votes proposed it."""

    obj: int
    views: int
    on_table: bool
    way: str
    poses: Hypotheses
    by_votes: Tensor


@dataclass(frozen=True)
class Offered:
    """What one cloud offers: how many distinct grasps geometry proposes, and the votes beyond them."""

    obj: int
    views: int
    geometry: int
    votes: int


def best(poses: Hypotheses, p: Tensor, made: Tried) -> Tensor:
    """Indices (<= 10,) of the most probable, no two of the same grasp."""
    alike, config = torch.zeros(len(p), dtype=torch.int64), made.config.proposing
    return non_maximum_suppression(poses.T, alike, p.float(), config.apart, config.apart_deg)[:BEST]


def chosen_in(made: Tried, clouds: Sequence[Described], folds: Mapping, names: Sequence[str]) -> list[Chosen]:
    """The best of every cloud by each set of numbers, by judges that have not seen the object."""

    def of(cloud: Described) -> list[Chosen]:
        bench, fold = made.benches[cloud.obj], folds[int(made.fold[cloud.obj])]
        its, numbers = bench.clouds[cloud.number], bench.numbers[cloud.number]
        top = fold.probability("judge", numbers, {}).prod(1).argsort(descending=True, stable=True)[:POOL]
        poses, pieces = bench.hypotheses[cloud.number].at(top), pieces_of(bench.obj.parts)
        added = fold.shapes.numbers(with_hands(cloud, poses, made, pieces))
        found = []
        for name in names:
            at = best(poses, fold.probability(name, numbers[top], added).prod(1), made)
            nowhere = torch.zeros(len(at), dtype=torch.bool)
            found.append(Chosen(cloud.obj, its.views, its.on_table, name, poses.at(at), nowhere))
        return found

    return [way for ways in in_parts(of, clouds) for way in ways]


def with_votes(made: Tried, clouds: Sequence[Described], folds: Mapping) -> tuple[list[Chosen], list[Offered]]:
    """The best of every cloud among the hypotheses of geometry and of the votes, and what either offers."""
    taught = examples(made, clouds)
    proposers = {
        held_out: proposer_of(made, [taught[i] for i in (made.fold != held_out).nonzero()[0]], fold.shapes.centres)
        for held_out, fold in folds.items()
    }

    def of(cloud: Described) -> tuple[Chosen, Offered]:
        bench, held_out = made.benches[cloud.obj], int(made.fold[cloud.obj])
        its, known = bench.clouds[cloud.number], bench.hypotheses[cloud.number]
        more = beyond_geometry(made, proposers[held_out], cloud, cloud.number)
        numbers = torch.cat([bench.numbers[cloud.number], judge_features(its.seen, more, made.search)])
        p = folds[held_out].probability("judge", numbers, {}).prod(1)
        poses = Hypotheses(torch.cat([known.T, more.T]), torch.cat([known.grasp_type, more.grasp_type]))
        at = best(poses, p, made)
        distinct = len(best_of_all(known, p[: len(known)], made))
        offered = Offered(cloud.obj, its.views, distinct, len(more))
        return Chosen(cloud.obj, its.views, its.on_table, VOTES, poses.at(at), at >= len(known)), offered

    both = list(in_parts(of, clouds))
    return [chosen for chosen, _ in both], [offered for _, offered in both]


def best_of_all(poses: Hypotheses, p: Tensor, made: Tried) -> Tensor:
    """As `best`, all of them."""
    alike, config = torch.zeros(len(p), dtype=torch.int64), made.config.proposing
    return non_maximum_suppression(poses.T, alike, p.float(), config.apart, config.apart_deg)


def executed(made: Tried, chosen: Sequence[Chosen]) -> list[Tensor]:
    """The outcomes (<= 10,) int64 of each; a pose that several chose is tried once."""
    number: dict[tuple[int, int, bytes], int] = {}
    poses: dict[int, list[tuple[Tensor, Tensor]]] = {}
    places = []
    for its in chosen:
        mine = poses.setdefault(its.obj, [])
        place = []
        for T, kind in zip(its.poses.T.float(), its.poses.grasp_type, strict=True):
            key = (its.obj, int(kind), T.numpy().tobytes())
            if key not in number:
                number[key] = len(mine)
                mine.append((T, kind))
            place.append(number[key])
        places.append(torch.tensor(place, dtype=torch.int64))
    ended = made.try_({
        obj: Hypotheses(torch.stack([T for T, _ in its]), torch.stack([k for _, k in its]))
        for obj, its in poses.items() if its
    })  # fmt: skip
    none = torch.zeros(0, dtype=torch.int64)
    return [ended.get(its.obj, none)[place] for its, place in zip(chosen, places, strict=True)]


def table(
    made: Tried, chosen: Sequence[Chosen], ended: Sequence[Tensor], against: Mapping[str, Sequence[str]]
) -> list[dict]:
    """A row for each way and number of views, over all objects; of the votes' hypotheses for each class as well."""
    rows = []
    classes = [bench.obj.category for bench in made.benches]
    for views in sorted({its.views for its in chosen}):
        pairs = [(c, e) for c, e in zip(chosen, ended, strict=True) if c.views == views]
        rows += [{"views": views, "objects": "all", **row} for row in _ways(pairs, against)]
        for name in sorted(set(classes)):
            its = [(c, e) for c, e in pairs if classes[c.obj] == name and c.way in (VOTES, *against[VOTES])]
            rows += [{"views": views, "objects": name, **row} for row in _ways(its, against)]
    return rows


def _ways(pairs: Sequence[tuple[Chosen, Tensor]], against: Mapping[str, Sequence[str]]) -> list[dict]:
    """A row for each way: its rate over objects, and the differences to those that it is compared with."""
    rows, rates = [], {}
    for way in dict.fromkeys(c.way for c, _ in pairs):
        its = [(c, e) for c, e in pairs if c.way == way]
        held: dict[int, list[float]] = {}
        for c, e in its:
            held.setdefault(c.obj, []).append(float((e == SUCCESS).sum()) / BEST)
        rates[way] = np.array([np.mean(held[obj]) for obj in sorted(held)])
        outcome, mine = (torch.cat(parts) for parts in ([e for _, e in its], [c.by_votes for c, _ in its]))
        row = {"way": way, "top10": words(rates[way], 100, 1)}
        row["collided"] = float((outcome == COLLISION).float().mean())
        for other in (other for other in against[way] if other in rates):
            row[f"more_than_{other}"] = words(rates[way] - rates[other], 100, 1)
        if mine.any():
            row["by_votes"] = float(mine.float().mean())
            row["held_of_them"] = float((outcome[mine] == SUCCESS).float().mean())
        rows.append(row)
    return rows


def offers(made: Tried, offered: Sequence[Offered]) -> list[dict]:
    """A row for each class of objects and number of views: where geometry offers too few, and what the votes add."""
    rows = []
    for views in sorted({its.views for its in offered}):
        for category in sorted({bench.obj.category for bench in made.benches}):
            its = [o for o in offered if o.views == views and made.benches[o.obj].obj.category == category]
            few = [o for o in its if o.geometry < BEST]
            rows.append({
                "views": views, "category": category, "clouds": len(its), "below_ten": len(few),
                "geometry": float(np.mean([o.geometry for o in its])), "votes": float(np.mean([o.votes for o in its])),
                "votes_where_below_ten": float(np.mean([o.votes for o in few])) if few else 0.0,
            })  # fmt: skip
    return rows
