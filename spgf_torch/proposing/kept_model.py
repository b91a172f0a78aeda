"""A model out of the folders that `train` and `judge` left, kept in a folder of its own."""

from __future__ import annotations

from pathlib import Path

from spgf_torch.affordance.model import load_model
from spgf_torch.affordance.small_config import SmallConfig
from spgf_torch.hands.carried_hand import load_carried
from spgf_torch.hands.config import HandConfig
from spgf_torch.proposing.judge import load_judge
from spgf_torch.proposing.model_folder import Identity, body, write_model
from spgf_torch.settings import typed


def keep(place: Path, rooms: tuple[Path | None, Path | None], small: SmallConfig | None) -> list[str]:
    """Write what is in the folders of votes and judge into a model's folder `place`; returns lines that tell of it.

    Args:
        rooms: one of them may be None, or both the same. small: how the votes are made small; None: they stay whole.

    Raises InputError for a folder that is damaged, or a judge of another hand.
    """
    votes, ranks = rooms
    model, judge = (None if votes is None else load_model(votes)), (None if ranks is None else load_judge(ranks))
    settings = (model or judge).settings["hand"]  # type: ignore[union-attr]
    if judge is not None:
        judge.check_hand(settings, "the model's hand")
    hand = load_carried(typed(HandConfig, settings), votes or ranks)  # type: ignore[arg-type]
    cards = "\n".join(body(each) for each in dict.fromkeys((votes, ranks)))
    size = write_model(place, model, judge, hand, small, cards)
    told = [f"{name}: {Identity.of(part).words()}" for name, part in (("votes", model), ("judge", judge)) if part]
    return [*told, f"{size / 1e6:.1f} MB in {place}, a model of predict and evaluate"]
