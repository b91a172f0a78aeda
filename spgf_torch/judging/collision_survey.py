"""Whether hypotheses are free, by the true mesh: it takes no trial to know, so many in many clouds teach P(free)."""

from __future__ import annotations

import zlib

import numpy as np
import torch

from spgf_torch.hands.config import grasp_types
from spgf_torch.hands.hand import Hand
from spgf_torch.judging.clouds import Cloud, further_clouds
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.training_rows import COLLISION, SURVEYED, UNTRIED, Bench, Rows
from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.proposing.judge_features import in_images, judge_features
from spgf_torch.simulation.precheck import PreCheck


def survey(bench: Bench, hand: Hand, search: Search, config: JudgeConfig) -> Rows:
    """Rows of `config.surveyed` hypotheses at random of each of an object's clouds, and of `config.looks` further ones.

    They are in no cloud of the bench, and no more is known of them than whether the open hand cuts the object: the
    trial's own pre-check.
    """
    rng = torch.Generator().manual_seed(zlib.crc32(f"{config.seed}/survey/{bench.obj.name}".encode()))
    checks = [PreCheck(bench.obj, hand.preshapes[name]) for name in grasp_types(hand.config)]
    pairs: list[tuple[Cloud, Hypotheses]] = list(zip(bench.clouds, bench.hypotheses, strict=True))
    for cloud in further_clouds(bench.obj, config):
        pairs.append((cloud, search.hypotheses(cloud.seen.texlets, cloud.around)))
    parts = []
    for cloud, hypotheses in pairs:
        some = hypotheses.at(torch.randperm(len(hypotheses), generator=rng)[: config.surveyed])
        some = some.at(in_images(cloud.seen, some, search))
        cuts = [checks[k].collides(T) for k, T in zip(some.grasp_type.tolist(), some.T.numpy(), strict=True)]
        outcome = torch.where(torch.tensor(cuts, dtype=torch.bool), COLLISION, UNTRIED)
        same = torch.ones_like(outcome)
        where = (bench.index * same, -same, 0 * same, SURVEYED * same, ~same.bool())
        said = torch.full((len(same),), np.nan)
        parts.append(Rows(judge_features(cloud.seen, some, search), outcome, *where, said))
    return Rows.together(parts)
