"""Which model and judge plan, and from which objects scenes are drawn."""

import pytest
from clearing_cases import OBJECTS, config

from spgf_torch.clearing.learned import Learned
from spgf_torch.errors import InputError
from spgf_torch.files.digests import sealed_json

FOLDS = {"tall": 1, "flat": 0, "cube": 1}


@pytest.fixture
def run(tmp_path):
    """A folder with a model and a judge, as far as names tell, and the folds of both."""
    for name in ("model.json", "model.safetensors", "judge.json", "judge.safetensors"):
        (tmp_path / name).write_text(name)
    for room in ("fold_models", "folds"):
        folds(tmp_path / room, FOLDS)
    return tmp_path


def folds(folder, of):
    folder.mkdir(exist_ok=True)
    about = {obj.name: {"fold": of[obj.name], "digest": obj.digest} for obj in OBJECTS if obj.name in of}
    (folder / "objects.json").write_bytes(sealed_json(about))


def test_without_folds_all_objects_are_one_pool(run):
    learned = Learned.of(config(model=run))
    assert learned.folders(None) == (str(run), str(run))
    assert [(fold, [obj.name for obj in pool]) for fold, pool in learned.pools(OBJECTS)] == [
        (None, ["tall", "flat", "cube"])
    ]


def test_held_out_each_fold_is_a_pool_with_its_own_model_and_judge(run):
    learned = Learned.of(config(model=run, held_out=True))
    pools = learned.pools(OBJECTS)
    assert [(fold, [obj.name for obj in pool]) for fold, pool in pools] == [(0, ["flat"]), (1, ["tall", "cube"])]
    assert learned.folders(1) == (str(run / "fold_models/1"), str(run / "folds/1"))
    assert Learned.of(config(model="none", judge=run, held_out=True)).folders(0) == ("none", str(run / "folds/0"))
    assert Learned.of(config(model=run, judge="none", held_out=True)).folders(0)[1] == "none"


def test_methods_without_learning_draw_from_the_same_pools(run):
    learned = Learned.of(config(model=run, held_out=True, method="antipodal"))
    assert [fold for fold, _ in learned.pools(OBJECTS)] == [0, 1]
    assert Learned.of(config(model="nowhere", method="antipodal")).pools(OBJECTS) == [(None, list(OBJECTS))]


def test_folds_that_differ_or_do_not_know_an_object_are_told(run):
    learned = Learned.of(config(model=run, held_out=True))
    folds(run / "folds", {**FOLDS, "cube": 0})
    with pytest.raises(InputError, match=r"^judge: expected the folds of the model in .*, got others in "):
        learned.pools(OBJECTS)
    for room in ("fold_models", "folds"):
        folds(run / room, {"tall": 1, "flat": 0})
    with pytest.raises(InputError, match=r"^held_out: expected objects of the run's cross-validation, got cube"):
        learned.pools(OBJECTS)


def test_the_shipped_judge_of_a_hand_plans_where_none_is_named():
    learned = Learned.of(config(hand="panda"))
    assert learned.votes == learned.judge is not None and learned.judge.parts[-2:] == ("models", "panda")
    with pytest.raises(
        InputError,
        match=r"^hand: expected a hand with a shipped model \(panda, .*so101\), got claw; of others: model=NAME or ",
    ):
        Learned.of(config(hand="panda", **{"hand.name": "claw"}))


@pytest.mark.parametrize(
    ("changes", "got"),
    [({"cgn": "python", "hand": "sdh2"}, "hand=sdh2"), ({"hand": "panda"}, "no cgn=PYTHON")],
)
def test_the_network_wants_its_hand_and_its_python(changes, got):
    with pytest.raises(InputError, match=f"^method: .* with hand=panda and cgn=PYTHON, got {got}"):
        Learned.of(config(method="contact_graspnet", **changes))


def test_what_may_plan_is_told_apart_by_digests(run):
    before = Learned.of(config(model=run)).digests()
    (run / "judge.json").write_text("another")
    after = Learned.of(config(model=run)).digests()
    assert len(before) == 4 and sum(a != b for a, b in zip(before, after, strict=True)) == 2  # one folder holds both
