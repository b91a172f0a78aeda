"""A judge's arrays say what scikit-learn says; its files come back as they were, or are refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from sklearn.ensemble import HistGradientBoostingClassifier

from spgf_torch.errors import InputError
from spgf_torch.files.digests import KEY, sealed_json
from spgf_torch.hands.config import HandConfig
from spgf_torch.judging.config import JudgeConfig, TreesConfig
from spgf_torch.judging.learning import fit, learn_judge, quantiles, trees_of, weights
from spgf_torch.judging.training_rows import Rows
from spgf_torch.proposing.config import HypothesesConfig
from spgf_torch.proposing.judge import Judge, load_judge, save_judge
from spgf_torch.proposing.judge_features import GEOMETRY, NAMES
from spgf_torch.proposing.tree_ensembles import Logistic, Trees
from spgf_torch.settings import plain, settings
from spgf_torch.simulation.table import OUTCOMES

COLLISION = OUTCOMES.index("collision")


def config(form: str = "trees") -> JudgeConfig:
    learning = settings(TreesConfig, trees=20, least=10)
    return JudgeConfig(form=form, learning=learning, hand=settings(HandConfig), hypotheses=settings(HypothesesConfig))


def rows(count: int = 600, seed: int = 0) -> Rows:
    """Trials whose collisions depend on the margin and whose holding depends on both pads, with some noise."""
    generator = torch.Generator().manual_seed(seed)
    numbers = torch.rand(count, len(NAMES), generator=generator)
    noise = 0.2 * torch.randn(count, generator=generator)
    outcome = torch.where(numbers[:, NAMES.index("anti_min")] + noise > 0.5, 0, OUTCOMES.index("missed"))
    outcome[numbers[:, NAMES.index("worst_finger")] + noise > 0.7] = COLLISION
    obj = torch.arange(count) % 7
    same = torch.zeros(count, dtype=torch.int64)
    return Rows(numbers, outcome, obj, same, same, same, same.bool(), same.float())


@pytest.fixture(scope="module", params=["trees", "logistic"])
def judge(request: pytest.FixtureRequest) -> Judge:
    made = plain(settings(HandConfig)), plain(settings(HypothesesConfig))
    factors = learn_judge(rows(), config(request.param))
    return Judge(factors, dict(zip(("hand", "hypotheses"), made, strict=True)), 0.8, {"egg": "1f"}, {"rows": 600})


@pytest.mark.parametrize(
    "depth", [{"max_leaf_nodes": 12}, {"max_leaf_nodes": 2}, {"max_leaf_nodes": None, "max_depth": 9}]
)
def test_trees_say_what_scikit_learn_says(depth: dict[str, int | None]) -> None:
    """Also on the very thresholds, and far outside of what was learned from."""
    taught = rows(2000)
    x = taught.numbers.double().numpy()
    learner = HistGradientBoostingClassifier(max_iter=30, random_state=0, min_samples_leaf=5, **depth).fit(
        x, taught.free
    )
    trees = trees_of(learner)
    trees.check(len(NAMES))
    edges = trees.threshold[trees.feature >= 0][:20].repeat(31, 1).T.numpy()
    asked = np.concatenate([x, 3 * x - 1, edges, np.nextafter(edges, 9), np.full((1, 31), 1e6)])
    said = trees.log_odds(torch.from_numpy(asked)).sigmoid().numpy()
    np.testing.assert_allclose(said, learner.predict_proba(asked)[:, 1], atol=1e-6)
    assert said.std() > 0.1


@pytest.mark.parametrize("distinct", [4, 3000])
def test_ranks_teach_the_same_trees(distinct: int) -> None:
    """Learned from ranks, asked about numbers: what scikit-learn says that learned from the numbers."""
    rng = np.random.default_rng(0)
    x = rng.integers(0, distinct, (1500, 3)) / distinct
    x[:, 2] = 7.0  # says nothing
    y = x[:, 0] + 0.3 * rng.standard_normal(1500) > 0.5
    ours = fit(torch.from_numpy(x), torch.from_numpy(y), torch.ones(1500), config())
    made = settings(TreesConfig, trees=20, least=10)
    theirs = HistGradientBoostingClassifier(
        max_iter=made.trees, learning_rate=made.rate, max_leaf_nodes=made.leaves, min_samples_leaf=made.least,
        l2_regularization=made.l2, early_stopping=False,
    ).fit(x, y)  # fmt: skip
    assert isinstance(ours, Trees)
    said, expected = ours.log_odds(torch.from_numpy(x)).sigmoid().numpy(), theirs.predict_proba(x)[:, 1]
    assert np.abs(said - expected).mean() < (1e-9 if distinct == 4 else 0.02)  # of many values: other quantiles
    assert np.corrcoef(said, expected)[0, 1] > 0.99
    edges = quantiles(x[:, 0])
    assert len(edges) == min(distinct - 1, 254) and not np.isin(edges, x[:, 0]).any() and (np.diff(edges) > 0).all()


def test_a_judge_learns_what_there_is_to_learn(judge: Judge) -> None:
    fresh = rows(400, seed=1)
    free, holds = judge.both(fresh.numbers, images=True)
    assert free[fresh.free].mean() > free[~fresh.free].mean() + 0.2
    assert holds[fresh.success].mean() > holds[fresh.free & ~fresh.success].mean() + 0.2
    p = judge.probability(fresh.numbers, images=True)
    torch.testing.assert_close(p.double(), free * holds, atol=1e-6, rtol=0)
    bare = fresh.numbers.clone()
    bare[:, len(GEOMETRY) :] = 99.0  # not known: never looked at
    assert torch.equal(judge.probability(bare, False), judge.probability(fresh.numbers, False))


def test_learning_repeats_to_the_bit() -> None:
    first, again = (learn_judge(rows(), config()) for _ in range(2))
    for key, trees in first.items():
        assert isinstance(trees, Trees)
        assert all(torch.equal(value, getattr(again[key], name)) for name, value in vars(trees).items())


def test_objects_weigh_alike() -> None:
    """However many rows they have, from fifty on."""
    few = rows(300)
    obj = torch.cat([torch.zeros(200), torch.ones(50), torch.full((50,), 2)]).long()
    weight = weights(Rows(few.numbers, few.outcome, obj, obj, obj, obj, obj > 0, obj.float()))
    sums = [float(weight[obj == k].sum()) for k in range(3)]
    assert sums == pytest.approx([100.0] * 3) and float(weight.mean()) == pytest.approx(1)


@pytest.mark.parametrize(("label", "expected"), [(True, 11 / 12), (False, 1 / 12)])
def test_one_outcome_alone_gives_its_smoothed_share(label: bool, expected: float) -> None:
    form = fit(torch.rand(10, 3), torch.full((10,), label), torch.ones(10), config())
    form.check(3)
    assert form.log_odds(torch.rand(4, 3)).sigmoid().tolist() == pytest.approx([expected] * 4)


def test_files_come_back(judge: Judge, tmp_path: Path) -> None:
    size = save_judge(judge, tmp_path)
    back = load_judge(tmp_path)
    fresh = rows(50, seed=2).numbers
    assert torch.equal(back.probability(fresh, True), judge.probability(fresh, True))
    assert torch.equal(back.probability(fresh, False), judge.probability(fresh, False))
    assert back.hypotheses == settings(HypothesesConfig) and back.taught == {"egg": "1f"} and back.sure == 0.8
    assert size == (tmp_path / "judge.safetensors").stat().st_size < 1e6
    (tmp_path / "again").mkdir()
    save_judge(back, tmp_path / "again")
    for name in ("judge.safetensors", "judge.json"):
        assert (tmp_path / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def refused(folder: Path, *words: str) -> None:
    with pytest.raises(InputError) as error:
        load_judge(folder)
    assert "\n" not in str(error.value) and all(word in str(error.value) for word in words), error.value


def test_damage_is_refused(judge: Judge, tmp_path: Path) -> None:
    refused(tmp_path, "judge.json", "python -m spgf_torch.judge")
    save_judge(judge, tmp_path)
    arrays, about = tmp_path / "judge.safetensors", tmp_path / "judge.json"
    whole, text = arrays.read_bytes(), about.read_bytes()
    for changed in (whole[:-9], whole[:2000] + bytes([whole[2000] ^ 4]) + whole[2001:], b""):
        arrays.write_bytes(changed)
        refused(tmp_path, "judge.safetensors")
    arrays.write_bytes(whole)
    for changed in (text[:-20], text.replace(b'"sure": 0.8', b'"sure": 0.1'), b"{}", b"[" * 9):
        about.write_bytes(changed)
        refused(tmp_path, "judge.json")
    about.unlink()
    (tmp_path / "other").mkdir()
    save_judge(Judge(learn_judge(rows(300, 7), config()), judge.settings, 0.8), tmp_path / "other")
    (tmp_path / "other/judge.json").rename(about)
    refused(tmp_path, "judge.safetensors", "judge.json beside it")


def test_another_hand_is_refused(judge: Judge) -> None:
    judge.check_hand(plain(settings(HandConfig)), "this hand")
    with pytest.raises(InputError, match=r"judge: expected one of this hand \(panda\), got one of sdh2; learn one"):
        judge.check_hand({"name": "panda"}, "this hand")
    with pytest.raises(InputError, match="other settings"):
        judge.check_hand({"name": "sdh2"}, "this hand")


@pytest.mark.parametrize(
    "change",
    [
        {"left": torch.tensor([0, 1, 2], dtype=torch.int32)},  # a node above itself: never ends
        {"feature": torch.tensor([9, -1, -1], dtype=torch.int16)},
        {"threshold": torch.tensor([torch.nan, 0, 0]).double()},
        {"value": torch.tensor([0.0, 1]).double()},
        {"root": torch.tensor([3], dtype=torch.int32)},
        {"right": torch.tensor([7, 1, 2], dtype=torch.int32)},
    ],
)
def test_trees_that_would_not_work_are_refused(change: dict[str, torch.Tensor]) -> None:
    one = {
        "root": torch.tensor([0], dtype=torch.int32),
        "baseline": torch.zeros(1).double(),
        "feature": torch.tensor([2, -1, -1], dtype=torch.int16),
        "threshold": torch.tensor([0.5, 0, 0]).double(),
        "left": torch.tensor([1, 1, 2], dtype=torch.int32),
        "right": torch.tensor([2, 1, 2], dtype=torch.int32),
        "value": torch.tensor([0, -1.0, 1]).double(),
    }
    Trees(**one).check(3)
    with pytest.raises(InputError):
        Trees(**{**one, **change}).check(3)


def test_the_logistic_form_by_hand() -> None:
    form = Logistic(*(torch.tensor(v).double() for v in ([1.0], [2.0], [3.0, 0.5], [0.25])))
    form.check(1)
    assert form.log_odds(torch.tensor([[3.0], [1.0]])).tolist() == [3 * 1 + 0.5 * 1 + 0.25, 0.25]
    with pytest.raises(InputError):
        form.check(2)


def test_calibration_keeps_the_order_and_the_product(judge: Judge, tmp_path: Path) -> None:
    """By number of images, none is another's; the factors' product stays what is told; files bring it back."""
    fresh = rows(200, seed=3).numbers
    fresh[:, NAMES.index("views")] = torch.tensor([1.0, 4.0]).repeat(100)
    doubting = replace(judge, calibration={"one": (0.5, 0.5, -1.0)})
    before, after = judge.probability(fresh, True), doubting.probability(fresh, True)
    assert torch.equal(before[1::2], after[1::2]) and (after[0::2] < before[0::2]).float().mean() > 0.5
    expected = (0.5 * before[0::2].logit() - 1.0).sigmoid()
    torch.testing.assert_close(after[0::2], expected, atol=1e-5, rtol=0)
    assert torch.equal(before[0::2].argsort(stable=True), after[0::2].argsort(stable=True))
    torch.testing.assert_close(torch.stack(doubting.both(fresh, True)).prod(0).float(), after)
    assert torch.equal(doubting.probability(fresh, False), judge.probability(fresh, False))
    save_judge(doubting, tmp_path)
    assert torch.equal(load_judge(tmp_path).probability(fresh, True), after)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "spgf_torch model"}, "expected format 'spgf_torch judge', schema 3"),
        ({"schema": 1}, "expected format 'spgf_torch judge', schema 3"),
        ({"numbers": list(NAMES[:-1])}, "expected a judge of this version's 31 numbers"),
        (
            {"forms": dict.fromkeys(("images.free", "images.holds", "bare.free"), "trees")},
            "expected forms of bare.free",
        ),
        ({"forms": dict.fromkeys(("images.free", "images.holds", "bare.free", "bare.holds"), "net")}, "expected forms"),
        ({"sure": "0.8"}, "expected sure, got '0.8'"),
        ({"taught": []}, "expected taught, got []"),
        ({"calibration": {"three": [1.0, 1.0, 0.0]}}, "expected calibration of one, more: two slopes > 0 and a shift"),
        ({"calibration": {"one": [1.0, 1.0]}}, "two slopes > 0 and a shift"),
        ({"calibration": {"one": [1.0, 0.0, 0.0]}}, "two slopes > 0 and a shift"),
        ({"calibration": {"more": [-0.1, 1.0, 0.0]}}, "two slopes > 0 and a shift"),
        ({"calibration": {"more": [1.0, True, 0.0]}}, "two slopes > 0 and a shift"),
        ({"settings": {"hand": {}}}, "settings.hand: "),
    ],
    ids=str,
)
def test_what_a_judge_says_of_itself_is_checked(change: dict, words: str, judge: Judge, tmp_path: Path) -> None:
    """Of a document that is whole, and sealed."""
    save_judge(judge, tmp_path)
    about = tmp_path / "judge.json"
    document = {name: value for name, value in json.loads(about.read_text()).items() if name != KEY}
    about.write_bytes(sealed_json(document, indent=1, sort_keys=True))
    load_judge(tmp_path)
    about.write_bytes(sealed_json({**document, **change}, indent=1, sort_keys=True))
    refused(tmp_path, str(about), words)
