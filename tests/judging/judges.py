"""A judge of little worth, made in a moment: what it says follows from a few numbers, without trials."""

from pathlib import Path
from typing import Any

import torch
from omegaconf import OmegaConf

from spgf_torch.hands.config import HandConfig
from spgf_torch.judging.config import JudgeConfig, TreesConfig
from spgf_torch.judging.learning import learn_judge
from spgf_torch.judging.training_rows import Rows
from spgf_torch.paths import find
from spgf_torch.proposing.config import HypothesesConfig
from spgf_torch.proposing.judge import Judge, save_judge
from spgf_torch.proposing.judge_features import NAMES
from spgf_torch.settings import plain, settings, typed


def quick_judge(hand: str = "sdh2", **changes: Any) -> Judge:
    """Taught that grasps hold whose pads face what they meet, and are free away from what is seen."""
    draw = torch.Generator().manual_seed(0)
    numbers = torch.rand(400, len(NAMES), generator=draw)
    asked = 0.1 + 0.8 * torch.rand(400, generator=draw)  # so that more is always better
    outcome = torch.where(numbers[:, NAMES.index("anti_max")] > asked, 0, 2)
    outcome[numbers[:, NAMES.index("worst_finger")] > 0.8] = 1
    same = torch.zeros(400, dtype=torch.int64)
    rows = Rows(numbers, outcome, same, same, same, same, same.bool(), same.float())
    its = typed(HandConfig, OmegaConf.to_container(OmegaConf.load(find(f"conf/hand/{hand}.yaml"))))
    config = JudgeConfig(form="trees", learning=settings(TreesConfig, trees=5, least=10))
    hypotheses = settings(HypothesesConfig, seeds=8, hypotheses=200)
    return Judge(
        learn_judge(rows, config), {"hand": plain(its), "hypotheses": plain(hypotheses)}, **{"sure": 0.8, **changes}
    )


def saved(judge: Judge, folder: Path) -> Path:
    folder.mkdir()
    save_judge(judge, folder)
    return folder
