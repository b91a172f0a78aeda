"""A judge from beginning to end, tiny: what it learns from, that it repeats, and what commands do with it."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from commands import here
from composing import composed
from sklearn.metrics import roc_auc_score

from spgf_torch.cache import Cache
from spgf_torch.errors import InputError
from spgf_torch.experiment.held_out import load_fold_judges
from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.hands.hand import load_hand
from spgf_torch.judge import run as learn
from spgf_torch.judging.clouds import seen_as, training_clouds
from spgf_torch.judging.collision_survey import survey
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.objects_that_fit import fits
from spgf_torch.judging.resumable_trials import KIND, tried
from spgf_torch.judging.rounds import choose
from spgf_torch.judging.training_rows import PICKED, Bench, Chosen, Rows
from spgf_torch.judging.validation import auc, calibrated_elsewhere, executed
from spgf_torch.objects.library import load_object, load_objects
from spgf_torch.proposing.antipodal import antipodal, antipodal_score
from spgf_torch.proposing.clearance import Clearance, Surroundings
from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.proposing.judge import load_judge
from spgf_torch.proposing.judge_features import NAMES
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import sense
from spgf_torch.sensing.unseen import behind
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.execute import execute
from spgf_torch.simulation.executors import InlineExecutor
from spgf_torch.simulation.worker import Trials

ROOT = Path(__file__).parents[2]
OBJECTS = ("soap_bar", "egg", "box_tea", "tumbler")
TINY = [
    "hand=panda",  # fewer parts than the SDH-2 has: half the physics
    "folds=2",
    "fold_judges=true",
    "candidates=8",
    "rounds=1",
    "best=3",
    "random=2",
    "one_view=1",
    "looks=1",
    "surveyed=20",
    "bootstrap=100",
    "workers=1",
    "hypotheses.seeds=6",
    "hypotheses.hypotheses=60",
    "learning.trees=8",
    "learning.least=3",
    "sensing.width=160",
    "sensing.height=120",
    "sensing.focal=144",
]

SCENES = [
    "context.number=1",
    "context.rounds=2",
    "context.measured=1",
    "context.count=2",
    "context.best=2",
    "context.random=2",
    "context.surveyed=20",
    "context.views=[1]",
    "context.proposing.neighbours.seeds=10",
]


def config(*overrides: str) -> JudgeConfig:
    return typed(JudgeConfig, composed("judge", *TINY, *overrides))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder with four objects, and a judge learned on them by the command."""
    folder = tmp_path_factory.mktemp("judging")
    (folder / "objects").mkdir()
    for name in OBJECTS:
        shutil.copy(ROOT / f"data/objects/{name}.yaml", folder / "objects")
    done = here("judge", "objects=objects", *TINY, cwd=folder)
    assert done.returncode == 0, done.stderr
    (folder / "stdout.txt").write_text(done.stdout)
    return folder


@pytest.fixture(scope="module")
def bench() -> tuple[Bench, Search, JudgeConfig]:
    made = config()
    obj = load_object(ROOT / "data/objects/soap_bar.yaml")
    search = Search.of(Clearance(open_hand(made.hand), 0.005, 0.015), made.hypotheses)
    return Bench.of(3, obj, training_clouds(obj, made), search), search, made


def test_the_command_leaves_a_judge(place: Path) -> None:
    run = place / "outputs/judge/latest"
    tables = {"trials", "own_trials", "folds"}
    assert {p.name for p in run.iterdir()} == {
        "config.yaml",
        "hand",
        "judge.json",
        "judge.safetensors",
        "README.md",
        *tables,
    }
    judge = load_judge(run)
    assert set(judge.taught) == set(OBJECTS) and judge.sure == 0.8
    kinds = {"1 view, alone", "1 view, on a table", "4 views, alone", "4 views, on a table"}
    assert set(judge.results["executed"]) == set(judge.results["cross_validated"]) == kinds
    for row in judge.results["executed"].values():
        assert row["objects"] == 4 >= row["fit"]["objects"] > 0 and 0 <= row["top3"] <= 1 and 0 <= row["ece"] <= 1
    assert set(judge.calibration) == {"one", "more"} and judge.results["unfit"].keys() == {"alone", "on a table"}
    card, told = (run / "README.md").read_text(), (place / "stdout.txt").read_text()
    assert all(kind in card and kind in told for kind in kinds) and "top 3" in told
    assert card.startswith("---\ntags: [robotics, ")


def test_each_fold_has_a_judge_that_has_not_seen_its_objects(place: Path) -> None:
    """Of each object, by its digest, exactly one of the two judges has not learned from it."""
    folds = load_fold_judges(place / "outputs/judge/latest")
    objects = load_objects(place / "objects")
    assert set(folds.models) == {0, 1} and {folds.fold_of(obj) for obj in objects} == {0, 1}
    for obj in objects:
        assert [obj.name in folds.models[fold].taught for fold in (0, 1)] == [
            folds.fold_of(obj) == 1,
            folds.fold_of(obj) == 0,
        ]
    one, other = (folds.models[fold].factors["images", "holds"].log_odds(torch.zeros(1, 31)) for fold in (0, 1))
    assert one != other and all(set(judge.calibration) == {"one", "more"} for judge in folds.models.values())


def test_the_same_call_gives_the_same_judge_and_tries_nothing_again(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place)
    monkeypatch.setattr(
        "spgf_torch.judging.resumable_trials.execute_words", lambda requests, *rest: iter([[] for _ in requests])
    )
    Path("again").mkdir()
    learn(config("objects=objects"), Path("again"))
    run = Path("outputs/judge/latest")
    assert (run / "judge.safetensors").read_bytes() == (Path("again") / "judge.safetensors").read_bytes()


def test_scenes_teach_and_their_trials_teach_again(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The judge of single objects is the same, and with the table of the trials it is taught again, without physics."""
    monkeypatch.chdir(place)
    run = "outputs/judge/latest"
    given = [f"trials={run}/trials", f"own_trials={run}/own_trials"]
    scenes = ["objects=objects", "+context=tabletop", *SCENES]
    (first := tmp_path / "first").mkdir()
    (second := tmp_path / "second").mkdir()
    learn(config(*scenes, *given), first)
    monkeypatch.setattr("spgf_torch.judging.scene_rounds.Attempts", None)
    learn(config(*scenes, f"known={run}", f"scene_trials={first}/scene_trials.parquet"), second)
    assert (first / "judge.safetensors").read_bytes() == (second / "judge.safetensors").read_bytes()
    old, new = load_judge(place / run), load_judge(first)
    assert new.knows_scenes and not old.knows_scenes and set(new.calibration) >= set(old.calibration) == {"one", "more"}
    numbers = torch.rand(5, 31)
    assert torch.equal(new.probability(numbers, True), old.probability(numbers, True))
    assert load_fold_judges(first).models[0].knows_scenes
    for block in new.results["in_scenes"].values():
        assert block["scenes"] in (1, 2) and -1 <= block["gain"] <= 1
    assert "## In scenes" in (first / "README.md").read_text()
    assert (first / "scene_trials.parquet").read_bytes() == (second / "scene_trials.parquet").read_bytes()


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["objects=nowhere"], ["nowhere"]),
        (["trials=nowhere"], ["nowhere", "simulate"]),
        (["objects=objects", "folds=6"], ["folds (6)", "got 4", "folds=4"]),
        (["objects=objects", "trials=empty"], ["config.yaml", "simulate"]),
        (["objects=objects", "known=empty"], ["known", "+context=tabletop"]),
        (["objects=objects", "known=empty", "+context=tabletop"], ["judge.json", "no such file"]),
        (["objects=objects", "+context=tabletop", "context.views=[0]"], ["context.views", "1 to 24", "[0]"]),
        (
            ["objects=objects", "+context=tabletop", "context.first_measured=15"],
            ["first_measured", "0 to 15", "15 to 26"],
        ),
    ],
)
def test_bad_input_is_refused(
    place: Path, tmp_path: Path, overrides: list[str], words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(place / "objects", "objects")
    Path("run").mkdir()
    Path("empty").mkdir()
    Path("empty/note").touch()
    with pytest.raises(InputError) as error:
        learn(config(*overrides, "cache=off"), Path("run"))
    assert "\n" not in str(error.value) and all(word in str(error.value) for word in words), error.value
    assert not list(Path("run").iterdir())


def test_clouds_are_those_of_an_object_alone_and_on_a_table(bench: tuple[Bench, Search, JudgeConfig]) -> None:
    obj, clouds = bench[0].obj, bench[0].clouds
    assert [(c.views, c.on_table) for c in clouds] == [(1, False), (4, False), (1, True), (4, True)]
    again = training_clouds(obj, bench[2])
    assert torch.equal(again[2].seen.texlets.positions, clouds[2].seen.texlets.positions)
    sensing = settings(SensingConfig, width=160, height=120, focal=144)
    alone = seen_as(obj, sensing, False, seed=4)
    assert torch.equal(alone.seen.texlets.positions, sense(obj, sensing, 4).positions)
    below = torch.tensor([[*obj.mesh.bounds.mean(0)[:2], obj.mesh.bounds[0, 2] - 0.03]]).float()
    assert behind(below, clouds[3].seen.views).item() > 0.01 and clouds[3].around.table is not None


def test_rows_of_a_pose_are_in_the_clouds_that_admit_it(bench: tuple[Bench, Search, JudgeConfig]) -> None:
    """A hypothesis of the cloud on the table is a row at home with the very numbers of its hypothesis."""
    its, search, _ = bench
    own = its.hypotheses[3]
    chosen = Chosen(own, torch.full((len(own),), 3), torch.arange(len(own)), torch.rand(len(own)))
    rows = its.rows(chosen, torch.arange(len(own)) % 3, 2, search)
    home = rows.at(rows.home)
    assert torch.equal(home.numbers, its.numbers[3]) and torch.equal(home.outcome, torch.arange(len(own)) % 3)
    assert set(rows.obj.tolist()) == {3} and set(rows.round.tolist()) == {2} and (home.cloud == 3).all()
    assert 0 < int((rows.cloud == 1).sum()) <= len(own)  # alone more is possible, but more is seen
    far = Hypotheses(own.T + torch.eye(4).roll(3, 1) * 0, own.grasp_type)
    far.T[:, 2, 3] += 1.0
    assert len(its.rows(replace(chosen, poses=far), rows.outcome[: len(own)], 1, search)) == 0


def test_a_round_takes_the_best_and_others(bench: tuple[Bench, Search, JudgeConfig], place: Path) -> None:
    its, search, made = bench
    judge = load_judge(place / "outputs/judge/latest")
    chosen, again = choose(its, judge, 1, made, search), choose(its, judge, 1, made, search)
    assert torch.equal(chosen.poses.T, again.poses.T)
    for cloud, numbers in enumerate(its.numbers):
        of_cloud = chosen.cloud == cloud
        p, rank = chosen.probability[of_cloud], chosen.rank[of_cloud]
        assert rank[rank >= 0].tolist() == [0, 1, 2] and (rank == PICKED).sum() == 2
        assert p[0] == judge.probability(numbers, True).max() and p[0] >= p[1] >= p[2]
        assert len(torch.unique(chosen.poses.T[of_cloud].flatten(1), dim=0)) == 5


def test_trials_that_have_ended_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut off after the first request, the next call tries only what is missing; a damaged entry is tried again."""
    made = config()
    obj = load_object(ROOT / "data/objects/egg.yaml")
    trials = Trials(load_hand(made.hand), made.episode)
    far = torch.eye(4).repeat(3, 1, 1)
    far[:, 2, 3] = torch.tensor([1.0, 2, 3])
    requests = [(obj, "NPG", far), (obj, "WPG", far[:2]), (obj, "WPG", far[1:])]
    asked: list[int] = []

    def fake(given: Any, *rest: Any) -> Any:
        for _, _, T in given:
            asked.append(len(T))
            yield ["missed", "dropped/lift/none/0/left_tip+right_tip", "slipped"][: len(T)]
            if len(asked) == 1:
                raise KeyboardInterrupt

    monkeypatch.setattr("spgf_torch.judging.resumable_trials.execute_words", fake)
    cache = Cache(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        tried(requests, trials, InlineExecutor, cache)
    ended = tried(requests, trials, InlineExecutor, cache)
    dropped = "dropped/lift/none/0/left_tip+right_tip"
    assert ended == [["missed", dropped, "slipped"], ["missed", dropped], ["missed", dropped]] and asked == [3, 2, 2]
    entry = max(tmp_path.glob(f"{KIND}-*"), key=lambda path: path.stat().st_size)
    entry.write_bytes(entry.read_bytes()[:-1])
    assert [len(o) for o in tried(requests, trials, InlineExecutor, cache)] == [3, 2, 2] and asked[3:] == [3]
    harder = Trials(trials.hand, replace(trials.episode, friction=0.1))
    tried(requests[:1], harder, InlineExecutor, cache)
    assert asked[4:] == [3]  # another episode is another trial


def test_auc_equals_scikit_learns() -> None:
    rng = np.random.default_rng(0)
    score, held = rng.integers(0, 6, 200) / 5, rng.random(200) < 0.3
    assert auc(score, held) == pytest.approx(roc_auc_score(held, score))
    assert auc(score, np.ones(200, bool)) == 0.5


def test_missing_hypotheses_count_as_failures(bench: tuple[Bench, Search, JudgeConfig]) -> None:
    """Two of `best` = 3 in one cloud, both held."""
    its, _, made = bench
    one = torch.ones(2, dtype=torch.int64)
    rows = Rows(torch.zeros(2, 31), 0 * one, 3 * one, 0 * one, 2 * one, torch.tensor([0, 1]), one.bool(), 0.9 * one)
    fold = np.array([0, 0, 0, 1])
    row = executed(rows, [its], fold, {3: {False: True, True: False}}, made)["1 view, alone"]
    assert row["top3"] == row["fit"]["top3"] == pytest.approx(2 / 3) and row["top1"] == 1
    assert row["ece"] == row["ece_uncalibrated"] == pytest.approx(0.1)  # nothing else was executed to calibrate with
    assert executed(rows, [its], fold, {3: {False: False, True: True}}, made)["1 view, alone"]["fit"] is None


def test_the_baseline_without_learning(bench: tuple[Bench, Search, JudgeConfig]) -> None:
    its, search, made = bench
    numbers = torch.zeros(3, 31)
    numbers[:, NAMES.index("anti_min")] = torch.tensor([0.0, 0.5, 0.5])
    numbers[:, NAMES.index("anti_max")] = 1.0
    numbers[:, NAMES.index("log_points")] = torch.log1p(torch.tensor([24.0, 12, 6]))
    assert antipodal_score(numbers).tolist() == pytest.approx([0.5, 0.75, 0.375])
    found = antipodal(search, made.proposing, its.clouds[1].seen, Surroundings())
    assert len(found.poses) > 3 and (found.probability.diff() <= 0).all()


def test_what_fits_a_hand_follows_from_its_shape() -> None:
    """A ball wider than the hand opens never; a book by its thickness, but not where it lies flat on a table."""
    made = config("hand=panda")
    search = Search.of(Clearance(open_hand(made.hand), 0.005, 0.015), made.hypotheses)
    names = {"ball_toy": (False, False), "book_paperback": (True, False), "soap_bar": (True, True)}
    for name, (alone, table) in names.items():
        obj = load_object(ROOT / f"data/objects/{name}.yaml")
        assert fits(obj, load_hand(made.hand), search, made) == {False: alone, True: table}, name


def test_calibration_is_learned_on_other_folds() -> None:
    """Nine in ten are said to hold, with one view half of them do: of that the fold itself tells nothing."""
    made, count = config(), 400
    numbers = torch.zeros(count, 31)
    numbers[:, NAMES.index("views")] = torch.tensor([1.0, 4.0]).repeat(count // 2)
    one, obj = torch.ones(count, dtype=torch.int64), torch.arange(count) // 200
    held = (torch.arange(count) // 2 % 2 == 0) | (numbers[:, NAMES.index("views")] == 4)
    best = Rows(numbers, (~held).long(), obj, 0 * one, one, 0 * one, one.bool(), 0.9 * one)
    said = calibrated_elsewhere(best, np.array([0, 1]), made)
    assert said[0::2].numpy() == pytest.approx(0.5, abs=0.02) and (said[1::2] > 0.95).all()
    best.outcome[200:] = 0
    again = calibrated_elsewhere(best, np.array([0, 1]), made)
    assert (again[:200] > 0.95).all() and torch.equal(again[200:], said[200:])


def test_a_survey_says_what_the_trials_would(bench: tuple[Bench, Search, JudgeConfig]) -> None:
    """Of each cloud and a further one 20 hypotheses; P(free) learns from them, what holds does not."""
    its, search, made = bench
    hand = load_hand(made.hand)
    rows = survey(its, hand, search, made)
    assert len(rows) == 5 * 20 and not rows.tried.any() and not rows.success.any() and not rows.home.any()
    assert 0 < rows.free.double().mean() < 1 and set(rows.obj.tolist()) == {3}
    assert torch.equal(rows.numbers, survey(its, hand, search, made).numbers)
    index = [int((its.numbers[0] == row).all(1).nonzero()[0, 0]) for row in rows.numbers[:20]]
    own = its.hypotheses[0].at(torch.tensor(index))
    for code, kind in enumerate(("NPG", "WPG")):
        mine = own.grasp_type == code
        outcome = next(execute([(its.obj, kind, own.T[mine])], Trials(hand, made.episode), 1))
        assert torch.equal(outcome != 1, rows.free[:20][mine])
