"""The models that come with the package: small, of the hands as they are described now, and learned on all objects."""

import pytest
import yaml
from commands import ROOT

from spgf_torch.affordance.model import load_model
from spgf_torch.hands.carried_hand import load_carried
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.predictor import Predictor, block
from spgf_torch.proposing.judge import load_judge
from spgf_torch.proposing.model_folder import Identity
from spgf_torch.settings import typed

HANDS = sorted(path.stem for path in (ROOT / "conf/hand").glob("*.yaml"))
LARGEST = 8_000_000  # bytes, with judge, hand and card


def test_every_shipped_hand_has_one() -> None:
    assert sorted(path.name for path in (ROOT / "data/models").iterdir()) == HANDS


@pytest.mark.parametrize("name", HANDS)
def test_a_model_is_small_and_of_its_hand(name: str) -> None:
    folder = ROOT / "data/models" / name
    assert sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) <= LARGEST
    votes, judge = load_model(folder), load_judge(folder)
    judge.check_hand(votes.settings["hand"], "the model's hand")
    carried = load_carried(typed(HandConfig, votes.settings["hand"]), folder)
    described = yaml.safe_load((ROOT / f"conf/hand/{name}.yaml").read_text(encoding="utf-8"))
    assert carried.digest == load_hand(typed(HandConfig, described)).digest
    for known in (Identity.of(votes), Identity.of(judge)):
        assert (known.hand, known.objects) == (name, 50) and known.date
        assert known.words() in (folder / "README.md").read_text(encoding="utf-8")
    assert len(votes.condensed.cell) > 100_000


def test_votes_take_no_part_in_what_a_judge_ranks() -> None:
    """So a small model of it proposes what a whole one does: its rates are the judge's."""
    folder = ROOT / "data/models/panda"
    model, alone = Predictor.load(folder), Predictor.load("none", judge=folder)
    seen = block(model.sensing.spacing)
    found, expected = model.predict(seen), alone.predict(seen)
    assert len(found) > 10 and any(grasp.support for grasp in found)
    for grasp, other in zip(found, expected, strict=True):
        assert (grasp.type, grasp.probability, grasp.score) == (other.type, other.probability, other.score)
        assert (grasp.T_input_tcp == other.T_input_tcp).all()


def test_no_card_names_a_folder_of_the_machine_that_learned() -> None:
    for card in (ROOT / "data/models").glob("*/README.md"):
        assert "`/" not in card.read_text(encoding="utf-8"), card
