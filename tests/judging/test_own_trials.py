"""Tables of trials that judges chose: the same bits come back, others are refused, and a judge is learned from them."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from composing import composed
from test_judging import OBJECTS, config

from spgf_torch.cache import Cache
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.geometry.se3 import random_poses
from spgf_torch.hands.hand import load_hand
from spgf_torch.judge import run as learn
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.own_trials import CHOICE, OwnProvenance, OwnTrials, read_own, write_own
from spgf_torch.judging.rounds import Workshop, random_tables
from spgf_torch.judging.settings import judge_settings
from spgf_torch.judging.training_rows import PICKED, Chosen
from spgf_torch.objects.library import load_object
from spgf_torch.progress import ProgressReporter
from spgf_torch.proposing.hypotheses import Hypotheses
from spgf_torch.settings import plain, typed
from spgf_torch.simulation import executors
from spgf_torch.simulation.execute import Trials, simulate
from spgf_torch.simulation.executors import InlineExecutor
from spgf_torch.simulation.table import OUTCOMES, read_table, write_table
from spgf_torch.train import run as train

ROOT = Path(__file__).parents[2]
TYPES = ("NPG", "WPG")


@pytest.fixture(scope="module")
def own() -> OwnTrials:
    """Two rounds of made-up trials on one object."""
    made = config("rounds=2")
    choice = {key: getattr(made, key) for key in CHOICE}
    provenance = OwnProvenance("egg", "1" * 64, "2" * 64, plain(made.episode), choice, plain(made.sensing))
    generator = torch.Generator().manual_seed(0)
    parts = []
    for number in (1, 2):
        poses = Hypotheses(random_poses(5, generator), torch.tensor([0, 1, 0, 1, 1]))
        rank = torch.tensor([0, 1, 2, PICKED, PICKED])
        chosen = Chosen(poses, torch.tensor([0, 1, 2, 3, 3]), rank, torch.rand(5, generator=generator))
        parts.append(replace(OwnTrials.of(provenance, chosen, number, TYPES), outcome=torch.arange(5) + number - 1))
        assert torch.allclose(parts[-1].chosen.poses.T, poses.T, atol=1e-6)
    return OwnTrials.together(parts)


def test_a_table_comes_back_bit_by_bit(own: OwnTrials, tmp_path: Path) -> None:
    write_own(tmp_path, own)
    back = read_own(tmp_path, [own.provenance], TYPES)[0]
    assert back.provenance == own.provenance and back.round.tolist() == [1] * 5 + [2] * 5
    for number in (1, 2):
        a, b = own.at_round(number), back.at_round(number)
        assert torch.equal(a.chosen.poses.T, b.chosen.poses.T) and torch.equal(a.outcome, b.outcome)
        assert torch.equal(a.probability, b.probability) and torch.equal(a.rank, b.rank)


def test_causes_of_a_robots_trials_come_back(own: OwnTrials, tmp_path: Path) -> None:
    """Of two rounds with other fingers each; of the other episode there are none."""
    assert own.causes is None
    robot = plain(config("episode=robot").episode)
    provenance = replace(own.provenance, episode=robot)
    words = [
        [f"dropped/shake/none/{1.5 * k:.4g}/{'left_tip' if k else ''}" for k in range(5)],
        ["success/held/none/9.5/", *["missed/lift/one_side/0/finger_1_tip+left_tip"] * 4],
    ]
    parts = [replace(own.at_round(number), provenance=provenance).ended(words[number - 1]) for number in (1, 2)]
    write_own(tmp_path, OwnTrials.together(parts))
    (back,) = read_own(tmp_path, [provenance], TYPES)
    assert back.causes is not None and back.causes.fingers == ("", "finger_1_tip+left_tip", "left_tip")
    for number in (1, 2):
        its = back.at_round(number)
        assert its.causes is not None
        labels = its.causes.labels([OUTCOMES[code] for code in its.outcome.tolist()])
        assert [label.word for label in labels] == words[number - 1]


def test_random_trials_of_a_robot_can_be_read_again(tmp_path: Path) -> None:
    """With the causes that `simulate` would write, kept in the cache on the way."""
    made = config("episode=robot_fast", "candidates=3")
    trials, obj = Trials(load_hand(made.hand), made.episode), load_object(ROOT / "data/objects/apple.yaml")
    shop = Workshop(trials, None, made, Cache(tmp_path / "cache"), ProgressReporter(), InlineExecutor)  # type: ignore[arg-type]
    (table,) = random_tables([obj], shop)
    write_table(tmp_path / "table.parquet", table)
    back = read_table(tmp_path / "table.parquet")
    (expected,) = simulate([obj], trials, made.sampler, 3, made.seed, workers=1)
    assert table.causes is not None and back.causes is not None and expected.causes is not None
    outcomes = [OUTCOMES[code] for code in expected.outcome.tolist()]
    assert torch.equal(back.outcome, expected.outcome)
    assert back.causes.labels(outcomes) == expected.causes.labels(outcomes)
    assert list((tmp_path / "cache").iterdir()) and len(outcomes) == 6


def test_types_that_nothing_was_chosen_of_keep_their_codes(own: OwnTrials, tmp_path: Path) -> None:
    """Of four types the judges chose the first and the third; to a hand without the third they are foreign."""
    four = ("claw", "hook", "pinch", "scoop")
    made = replace(own, grasp_type=2 * own.grasp_type, grasp_types=four)
    write_own(tmp_path, made)
    (back,) = read_own(tmp_path, [own.provenance], four)
    assert back.grasp_types == four and back.grasp_type.tolist() == [0, 2, 0, 2, 2] * 2
    assert back.at_round(2).grasp_types == four
    with pytest.raises(InputError, match="expected type one of claw, hook, scoop; got pinch"):
        read_own(tmp_path, [own.provenance], ("claw", "hook", "scoop"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"hand_digest": "0" * 64}, ["hand_digest"]),
        ({"object_digest": "0" * 64}, ["object_digest"]),
        ({"judging": {"best": 4}}, ["judging.best", "4", "3"]),
        ({"sensing": {"width": 320}}, ["sensing.width", "320", "160"]),
    ],
)
def test_tables_of_something_else_are_refused(own: OwnTrials, tmp_path: Path, change: dict, words: list[str]) -> None:
    write_own(tmp_path, own)
    values = {key: {**getattr(own.provenance, key), **v} if isinstance(v, dict) else v for key, v in change.items()}
    with pytest.raises(InputError) as error:
        read_own(tmp_path, [replace(own.provenance, **values)], TYPES)
    assert all(word in str(error.value) for word in ["egg.parquet", *words]), error.value


def test_damaged_tables_are_refused(own: OwnTrials, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"egg\.parquet: expected a table .* no such file"):
        read_own(tmp_path, [own.provenance], TYPES)
    for name, values in (("rank", [7] * 10), ("cloud", [9] * 10), ("probability", [1.5] * 10), ("round", [4] * 10)):
        write_own(tmp_path, replace(own, **{name: torch.tensor(values)}))
        with pytest.raises(InputError, match=rf"expected {name} from"):
            read_own(tmp_path, [own.provenance], TYPES)
    write_own(tmp_path, own)
    path = tmp_path / "egg.parquet"
    content = bytearray(path.read_bytes())
    content[200] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match="damaged or edited"):
        read_own(tmp_path, [own.provenance], TYPES)
    shutil.copy(ROOT / "data/trials/egg.parquet", path)
    with pytest.raises(InputError, match=r"egg\.parquet: expected a table of trials that judges chose"):
        read_own(tmp_path, [own.provenance], TYPES)


def test_a_judge_from_tables_is_that_of_the_run_to_the_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In two processes, or none at all: without physics from the tables that the first call left."""
    monkeypatch.chdir(tmp_path)
    Path("objects").mkdir()
    for name in OBJECTS[:2]:
        shutil.copy(ROOT / f"data/objects/{name}.yaml", "objects")
    few = ["objects=objects", "four_views=0", "candidates=8", "best=2", "random=1", "fold_judges=false", "cache=off"]
    for run in ("first", "second"):
        Path(run).mkdir()
    learn(config(*few), Path("first"))
    monkeypatch.setattr("spgf_torch.judging.resumable_trials.execute_words", None)
    learn(config(*few, "trials=first/trials", "own_trials=first/own_trials"), Path("second"))
    assert {path.name for path in Path("second").iterdir()} == {"hand", "judge.json", "judge.safetensors", "README.md"}
    for name in ("judge.json", "judge.safetensors", "README.md"):
        assert Path("first", name).read_bytes() == Path("second", name).read_bytes()


def test_train_learns_with_the_settings_of_judge() -> None:
    shared = ["hand=panda", "seed=3", "objects=here", "sensing.width=160"]
    its = judge_settings(typed(TrainConfig, composed("train", "K=3", *shared, "+judging.rounds=3")))
    assert its == typed(JudgeConfig, composed("judge", *shared, "rounds=3", "trials=data/trials"))
    for key, words in (("rouds", ["judging", "rounds"]), ("seed", ["judging.seed", "run's own"])):
        with pytest.raises(InputError) as error:
            judge_settings(typed(TrainConfig, composed("train", "K=3", f"+judging.{key}=1")))
        assert all(word in str(error.value) for word in words), error.value


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["own_trials=data/trials"], ["own_trials", "judge=learn"]),
        (["+judging.rounds=1"], ["judging", "judge=learn"]),
        (["judge=learn", "own_trials=nowhere"], ["own_trials", "nowhere"]),
        (
            ["hand=panda", "judge=learn", "trials=tables", "objects=objects"],
            ["hand_digest"],
        ),  # not where they are given
    ],
)
def test_what_train_refuses(
    overrides: list[str], words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("objects", "run"):
        Path(name).mkdir()
    for name in OBJECTS:
        shutil.copy(ROOT / f"data/objects/{name}.yaml", "objects")
    Path("tables").symlink_to(ROOT / "data/trials")
    with pytest.raises(InputError) as error:
        train(typed(TrainConfig, composed("train", "K=3", "folds=2", "cache=off", *overrides)), Path("run"))
    assert "\n" not in str(error.value) and all(word in str(error.value) for word in words), error.value
    assert not list(Path("run").iterdir())


def test_rounds_run_where_simulate_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "DaskExecutor", lambda address, limit: (address, limit))
    assert executors.executor_of(0, 7.0, "tcp://there:1") == ("tcp://there:1", 7.0)
    assert isinstance(executors.executor_of(1), executors.InlineExecutor)
    local = executors.executor_of(3, 7.0)
    assert isinstance(local, executors.ProcessExecutor) and (local.workers, local.limit) == (3, 7.0)
    with pytest.raises(InputError, match="address: expected that of a Dask scheduler with runner=dask"):
        executors.check_address("dask", None)
