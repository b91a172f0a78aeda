"""Every command from the outside: one tiny run each, what it leaves, and what it says to bad input."""

import json
import runpy
import shutil
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
import yaml
from commands import Ended, here, in_turn
from composing import composed

import spgf_torch
from spgf_torch.affordance.model import load_model
from spgf_torch.errors import InputError
from spgf_torch.evaluate import run as evaluate
from spgf_torch.experiment.config import EvaluateConfig, TrainConfig
from spgf_torch.experiment.held_out import load_fold_models
from spgf_torch.formats.graspnet import read_graspnet
from spgf_torch.formats.grasps_json import read_grasps
from spgf_torch.formats.isaac import read_isaac
from spgf_torch.objects.library import load_objects
from spgf_torch.predict import run as predict
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.reporting.data.predictions import predictions_of
from spgf_torch.reporting.data.runs import load_runs
from spgf_torch.reporting.data.sweep import find_sweep
from spgf_torch.reporting.pages.context import choose
from spgf_torch.reporting.pages.rate_parts import table_part
from spgf_torch.reporting.pages.table1 import table1
from spgf_torch.scene.config import PredictConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import sense
from spgf_torch.settings import settings, typed
from spgf_torch.simulate import run as simulate
from spgf_torch.simulation.config import SimulateConfig
from spgf_torch.train import run as train

ROOT = Path(__file__).parents[2]
NAMES = ("bowl_sugar", "mug_coffee", "jar_jam", "tumbler", "soap_bar", "box_tea", "sponge", "apple", "egg", "can_soda")
TINY = [
    "K=4",
    "folds=2",
    "bootstrap=100",
    "sensing.width=160",
    "sensing.height=120",
    "sensing.focal=144",
    "affordance.features_per_object=60",
    "prototypes.restarts=2",
    "prototypes.subsample=1000",
    "inner_grasps=200",
]


def says(run: Callable, kind: type, words: list[str], command: str, *overrides: str) -> None:
    """The command, in this process, refuses in one line with all the words, and leaves nothing."""
    Path("run").mkdir()
    with pytest.raises(InputError) as error:
        run(typed(kind, composed(command, *overrides)), Path("run"))
    assert "\n" not in str(error.value) and all(word in str(error.value) for word in words), error.value
    assert not list(Path("run").iterdir())


def refused(done: Ended, *words: str) -> None:
    """One line with all the words, status 2, no traceback."""
    assert done.returncode == 2, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert all(word in done.stderr for word in words), done.stderr


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder with ten of the objects and their trials, and a model trained on them."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "objects").mkdir()
    (folder / "trials").mkdir()
    for name in NAMES:
        shutil.copy(ROOT / f"data/objects/{name}.yaml", folder / "objects")
        shutil.copy(ROOT / f"data/trials/{name}.parquet", folder / "trials")
    shutil.copy(ROOT / "data/trials/config.yaml", folder / "trials")
    done = here("train", "objects=objects", "trials=trials", "fold_models=true", *TINY, cwd=folder)
    assert done.returncode == 0, done.stderr
    (folder / "stdout.txt").write_text(done.stdout)
    (folder / "stderr.txt").write_text(done.stderr)
    return folder


def test_train_leaves_what_the_contract_says(small: Path) -> None:
    run = small / "outputs/train/latest"
    assert {p.name for p in run.iterdir()} == {
        "config.yaml", "results.json", "per_object.csv", "predictions.parquet",
        "model.safetensors", "model.json", "README.md", "fold_models", "hand",
    }  # fmt: skip
    results = json.loads((run / "results.json").read_text())
    assert (
        results["K"] == 4
        and results["folds"] == 2
        and set(results["by_ranking"]) == {"paper", "log_odds", "log_odds_free", "calibrated", "nested"}
    )
    assert {"sensing", "features", "prototypes", "voting", "total"} <= set(results["seconds"])
    assert results["ceiling"]["all"]["CG"] == 1.0
    assert yaml.safe_load((run / "config.yaml").read_text())["prototypes"]["num_clusters"] == 4
    assert len((run / "per_object.csv").read_text().splitlines()) == 1 + len(NAMES)
    assert "K = 4" in (small / "stdout.txt").read_text() and "nested" in (small / "stdout.txt").read_text()
    assert "K = 4" in (run / "README.md").read_text() and set(results["chosen"]) == {"0", "1"}
    assert "sensing" in (small / "stderr.txt").read_text()


def trained(folder: Path, *overrides: str) -> tuple[dict[str, Any], str]:
    """Results and model card of `train` in this process, on the objects of `small`."""
    folder.mkdir()
    train(typed(TrainConfig, composed("train", "objects=objects", "trials=trials", *TINY, *overrides)), folder)
    return json.loads((folder / "results.json").read_text()), (folder / "README.md").read_text()


def test_prototypes_of_another_model(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the same folds they are what would be learned here; of a model of all objects they know the novel ones."""
    monkeypatch.chdir(small)
    run, alone = Path("outputs/train/latest"), tmp_path / "alone"
    first = json.loads((run / "results.json").read_text())
    results, card = trained(tmp_path / "by_fold", f"prototypes_from={run}")
    for ranking in (
        "paper",
        "log_odds",
        "log_odds_free",
    ):  # the others also ask inner folds, whose prototypes are given
        assert results["by_ranking"][ranking] == first["by_ranking"][ranking]
    assert results["prototypes_from"]["by_fold"] and results["prototypes_from"]["seen"] == 0
    assert "has seen none of the novel objects" in card
    alone.mkdir()
    for name in ("model.json", "model.safetensors"):
        shutil.copy(run / name, alone)
    results, card = trained(tmp_path / "of_all", f"prototypes_from={alone}")
    assert results["prototypes_from"]["seen"] == len(NAMES) and not results["prototypes_from"]["by_fold"]
    assert "a model of sdh2" in card and "knows the shapes of 10 of the novel objects" in capsys.readouterr().out
    assert torch.equal(load_model(tmp_path / "of_all").centres, load_model(alone).centres)


def test_words_over_constellations_vote(small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a word they are the paper's prototypes; a model keeps none, and what cannot be is refused."""
    monkeypatch.chdir(small)
    given = ["objects=objects", "trials=trials", *TINY, "constellations.words=6"]
    (tmp_path / "words").mkdir()
    train(typed(TrainConfig, composed("train", *given, "final_model=false")), tmp_path / "words")
    results = json.loads((tmp_path / "words/results.json").read_text())
    first = json.loads(Path("outputs/train/latest/results.json").read_text())
    assert results["random"] == first["random"] and results["calibration"] != first["calibration"]
    assert not (tmp_path / "words/model.json").exists()
    monkeypatch.chdir(tmp_path)
    says(train, TrainConfig, ["constellations.words: expected with final_model=false"], "train", *given)
    Path("run").rmdir()
    bent = [*given, "final_model=false", "constellations.inner=0.06"]
    says(train, TrainConfig, ["constellations.inner: expected less than outer, 0.06 m, got 0.06"], "train", *bent)


def test_prototypes_that_do_not_fit(small: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "objects").symlink_to(small / "objects")
    (tmp_path / "trials").symlink_to(small / "trials")
    (tmp_path / "model").symlink_to((small / "outputs/train/latest").resolve())
    monkeypatch.chdir(tmp_path)
    for folder, name in (("bare", "results.json"), ("judged", "judge.json")):
        Path(folder).mkdir()
        Path(folder, name).write_text("{}")
    given = ["objects=objects", "trials=trials", *TINY, "prototypes_from=model"]
    for words, changed in (
        (["K: expected 4, the number of prototypes of model, got 5"], "K=5"),
        (["features.radius: expected 0.03, as the prototypes of model", "got 0.02"], "features.radius=0.02"),
        (["prototypes_from: expected a model", "got none"], "prototypes_from=none"),
        (["prototypes_from: ", "final_model=true", "got no name"], "prototypes_from="),
        (["prototypes_from: ", "final_model=true", "no model.json at bare"], "prototypes_from=bare"),
        (["prototypes_from: ", "final_model=true", "a judge alone at judged"], "prototypes_from=judged"),
    ):
        says(train, TrainConfig, words, "train", *given, changed)
        Path("run").rmdir()


def test_the_same_settings_give_the_same_results(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """But for what it cost; here from the cache, and in another process."""
    monkeypatch.chdir(small)
    Path("again").mkdir()
    train(typed(TrainConfig, composed("train", "objects=objects", "trials=trials", *TINY)), Path("again"))
    runs = (Path("outputs/train/latest"), Path("again"))
    first, second = (json.loads((run / "results.json").read_text()) for run in runs)
    cost = {"seconds", "costs", "from_cache", "files", "seal"}
    assert {k: first[k] for k in first.keys() - cost} == {k: second[k] for k in second.keys() - cost}
    assert second["from_cache"]["features"] == len(NAMES) and not first["from_cache"]
    assert len({(run / "model.safetensors").read_bytes() for run in runs}) == 1


def test_a_judge_joins_the_rankings(
    small: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Under its own name, in all that a run leaves; the others stay as they are without it."""
    monkeypatch.chdir(small)
    Path("judged").mkdir()
    asked = [*TINY, "ranking=judge", "final_model=false", "objects=objects", "trials=trials"]
    Path("judged/config.yaml").write_text(yaml.safe_dump(composed("train", *asked)))
    train(typed(TrainConfig, composed("train", *asked)), Path("judged"))
    first, second = (json.loads((Path(run) / "results.json").read_text()) for run in ("outputs/train/latest", "judged"))
    judged = second["by_ranking"].pop("judge")
    assert second["by_ranking"] == first["by_ranking"] and "judge_minus_nested" not in first
    assert second["success_rate"] == judged and second["random"]["all"]["WPG"] < judged["all"]["WPG"] <= 1
    low, high = second["judge_minus_nested"]["interval95"]["all"]["CG"]
    mean = judged["all"]["CG"] - second["by_ranking"]["nested"]["all"]["CG"]
    assert second["judge_minus_nested"]["mean"]["all"]["CG"] == pytest.approx(mean, abs=1e-5) and low <= mean <= high
    assert second["calibration"] == first["calibration"]
    assert 0 < second["calibration_by_ranking"]["judge"]["WPG"]["ece"] < 0.5
    printed = capsys.readouterr().out
    assert "judge minus nested" in printed and "also knows unseen space" in printed
    told: list[str] = []
    sweep = find_sweep(load_runs("judged", told.append), 100, 0, told.append)
    context = choose(typed(ReportConfig, composed("report")), sweep, told.append)
    table = table1(sweep.rows, sweep.classwise(), context.rankings, context.row)
    assert "ranking: judge" in [group.heading for group in table.groups]
    assert len(predictions_of(context.shown, "judge")) == len(NAMES) and not told
    assert "knows more than the votes" in table_part(context, table).section.body


def test_each_class_by_itself(small: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Three folds of each class, which are novel to the rest of their class; the printed rates are the row [*]."""
    monkeypatch.chdir(small)
    Path("alone").mkdir()
    fewer = ["folds=3", "affordance.features_per_object=15", "inner_grasps=50"]
    asked = [*TINY, *fewer, "classwise=true", "objects=objects", "trials=trials"]
    train(typed(TrainConfig, composed("train", *asked)), Path("alone"))
    results = json.loads((Path("alone") / "results.json").read_text())
    assert results["classwise"] is True and results["folds"] == 9 and set(results["chosen"]) == set(map(str, range(9)))
    printed = capsys.readouterr().out
    assert "each class by itself" in printed and "84.0" in printed and "no model" in printed
    assert not (Path("alone") / "model.safetensors").exists() and not (Path("alone") / "README.md").exists()


def test_a_class_with_too_few_objects_is_refused(tmp_path: Path, small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three boxes in two folds: one of them would learn from the single box of the other."""
    monkeypatch.chdir(tmp_path)
    asked = [*TINY, "classwise=true", f"objects={small / 'objects'}", f"trials={small / 'trials'}"]
    says(train, TrainConfig, ["objects", "two at least", "of each class", "got 1"], "train", *asked)


def test_a_judge_of_single_classes_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    asked = [
        "K=4",
        "classwise=true",
        "judge=learn",
        f"objects={ROOT / 'data/objects'}",
        f"trials={ROOT / 'data/trials'}",
    ]
    says(train, TrainConfig, ["classwise", "false with judge=learn", "got true"], "train", *asked)


def test_what_needs_no_work_is_told_at_once(tmp_path: Path) -> None:
    """Bad settings, help, and the settings themselves leave nothing."""
    lines = (
        ["train", "+Kk=7"],
        ["train", "features.radius=-1"],
        ["evaluate", "--help"],
        ["train", "+K=7", "--cfg", "job"],
    )
    ended = in_turn(*([f"spgf_torch.{command}", *more] for command, *more in lines), cwd=tmp_path)
    refused(ended[0], "Kk")
    refused(ended[1], "features.radius", "got -1")
    help_, shown = ended[2:]
    assert help_.returncode == 0 and "\n  --objects" in help_.stdout and "--hand NAME" in help_.stdout
    assert shown.returncode == 0 and yaml.safe_load(shown.stdout)["K"] == 7
    assert not (tmp_path / "outputs").exists()


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["device=abacus"], ["device", "abacus"]),
        (["objects=nowhere"], ["nowhere"]),
        (["trials=nowhere"], ["nowhere", "simulate"]),
        (["address=tcp://here:1"], ["address", "runner=dask"]),
        (["runner=dask"], ["address", "got none"]),
    ],
)
def test_train_refuses_bad_input(
    overrides: list[str], words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    says(train, TrainConfig, words, "train", "K=4", *overrides)


def test_train_refuses_trials_of_another_episode(small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    given = (f"objects={small}/objects", f"trials={small}/trials", "episode.friction=0.5")
    says(train, TrainConfig, ["parquet", "episode.friction", "0.5"], "train", *given, *TINY)


def test_train_refuses_damaged_trials(small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(small / "trials", tmp_path / "trials")
    path = tmp_path / "trials/egg.parquet"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    command = ("train", f"objects={small}/objects", "trials=trials", *TINY)
    says(train, TrainConfig, ["egg.parquet", "damaged"], *command)
    (tmp_path / "trials/config.yaml").write_text("candidates: [1")
    Path("run").rmdir()
    says(train, TrainConfig, ["config.yaml", "candidates and seed"], *command)


def test_simulate_makes_a_table_once(small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "objects").mkdir()
    shutil.copy(small / "objects/egg.yaml", tmp_path / "objects")
    command = ["objects=objects", "candidates=12", "out=table", "workers=1"]
    done = here("simulate", *command, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "24" in done.stderr and "candidates/s" in done.stdout
    made = (tmp_path / "table/egg.parquet").read_bytes()
    monkeypatch.chdir(tmp_path)
    simulate(typed(SimulateConfig, composed("simulate", *command)), tmp_path / "run")  # finished work is kept
    assert (tmp_path / "table/egg.parquet").read_bytes() == made
    says(simulate, SimulateConfig, ["egg.parquet", "seed 1", "got 0"], "simulate", *command, "seed=1")
    Path("run").rmdir()
    says(simulate, SimulateConfig, ["out", "egg.parquet"], "simulate", "objects=objects", "out=table/egg.parquet")


@pytest.fixture(scope="module")
def scanned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one closed mesh of a block and its manifest."""
    folder = tmp_path_factory.mktemp("scanned")
    block = trimesh.creation.box((0.05, 0.06, 0.08)).subdivide().subdivide()
    block.apply_translation((0, 0, 0.04))
    block.export(folder / "block.ply")
    (folder / "manifest.csv").write_text("name,file,class\nblock,block.ply,box\n")
    return folder


def test_evaluate_executes_the_best_grasps(small: Path, scanned: Path) -> None:
    command = [f"objects={scanned}", "random_trials=5", "N=3", "bootstrap=100", "workers=1"]
    done = here("evaluate", *command, "proposing.point_support=2", cwd=small)
    assert done.returncode == 0 and "block" in done.stdout, done.stderr
    executed(small / "outputs/evaluate/latest")


def sampled(small: Path, scanned: Path, name: str, *more: str) -> Path:
    """The run of `evaluate`, in this process, on candidates of the mesh."""
    few = ["random_trials=5", "N=3", "bootstrap=100", "candidates=sampled", "samples=60"]
    with chdir(small):
        Path(name).mkdir()
        evaluate(typed(EvaluateConfig, composed("evaluate", f"objects={scanned}", *few, *more)), Path(name))
    return small / name


@pytest.fixture(scope="module")
def alone(small: Path, scanned: Path) -> Path:
    """With one worker and SAPIEN."""
    return sampled(small, scanned, "engine_alone", "workers=1")


def test_evaluate_executes_candidates_of_the_mesh(alone: Path) -> None:
    executed(alone)


def test_evaluate_asks_a_second_engine(small: Path, scanned: Path, alone: Path) -> None:
    """The same bytes with one worker and two; what SAPIEN finds is what it finds alone; each file tells of both."""
    pytest.importorskip("mujoco")
    both = sampled(small, scanned, "engines_both", "engine=both", "workers=1")
    again = sampled(small, scanned, "engines_again", "engine=both", "workers=2")
    first, one, two = (json.loads((run / "results.json").read_text()) for run in (alone, both, again))
    assert one["engines"] == two["engines"] and one["success_rate"] == first["success_rate"] and "engines" not in first
    assert one["engines"]["sapien"]["success_rate"] == first["success_rate"]
    assert (both / "engines.csv").read_bytes() == (again / "engines.csv").read_bytes()
    assert (both / "index.html").read_text() == (again / "index.html").read_text()
    assert one["engines"]["agreement"]["best"]["grasps"] == 3


def executed(run: Path) -> None:
    """What evaluate leaves of the block."""
    results = json.loads((run / "results.json").read_text())
    assert results["schema"] == 1 and results["N"] == 3
    row = results["per_object"][0]
    assert row["object"] == "block" and row["class"] == "boxes" and row["seconds"] > 0 and 0 <= row["CG"] <= 1


def test_held_out_objects_meet_models_that_have_not_seen_them(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(small)
    run = small / "outputs/train/latest"
    folds = load_fold_models(run)
    for obj in load_objects(small / "objects"):
        for fold, model in folds.models.items():
            assert (obj.digest in model.settings["taught"].values()) == (fold != folds.fold_of(obj))
    some, which = NAMES[::3], {folds.fold_of(obj) for obj in load_objects(small / "objects") if obj.name in NAMES[::3]}
    assert which == set(folds.models)
    Path("some").mkdir()
    for name in some:
        shutil.copy(f"objects/{name}.yaml", "some")
    tiny = ["proposing.point_support=2", "random_trials=2", "N=2", "bootstrap=100", "workers=1"]
    Path("held_out").mkdir()
    config = composed("evaluate", "objects=some", f"model={run}", "held_out=true", *tiny)
    evaluate(typed(EvaluateConfig, config), Path("held_out"))
    results = json.loads(Path("held_out/results.json").read_text())
    assert results["held_out"] and [row["object"] for row in results["per_object"]] == sorted(some)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["held_out=true"], ["held_out", "block"]),
        (["objects=nowhere"], ["nowhere"]),
        (["objects=empty"], ["empty", "mesh"]),
        (["objects=large"], ["block.ply", "unit=mm"]),
        (["objects=empty", "model=nowhere"], ["model: ", "latest or a folder, got nowhere"]),
        (["objects=empty", "model=empty/"], ["empty/model.json", "no such file"]),
        (["hand.closing.effort=1"], ["hand"]),
    ],
)
def test_evaluate_refuses_bad_input(
    small: Path,
    scanned: Path,
    tmp_path: Path,
    overrides: list[str],
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    shutil.copytree(scanned, tmp_path / "large")
    trimesh.load_mesh(scanned / "block.ply").apply_scale(1000).export(tmp_path / "large/block.ply")
    model = [] if any(o.startswith("model=") for o in overrides) else [f"model={small}/outputs/train/latest"]
    model += [] if any(o.startswith("objects=") for o in overrides) else [f"objects={scanned}"]
    says(evaluate, EvaluateConfig, words, "evaluate", *overrides, *model)


@pytest.fixture(scope="module")
def seen() -> np.ndarray:
    """Points and normals (N, 6) of a mug, as four cameras see it."""
    mug = next(obj for obj in load_objects(ROOT / "data/objects") if obj.name == "mug_coffee")
    texlets = sense(mug, settings(SensingConfig, spacing=0.002), seed=1)
    return np.concatenate([texlets.positions.numpy(), texlets.normals.numpy()], axis=1)


def test_predict_writes_what_robots_read(small: Path, seen: np.ndarray, tmp_path: Path) -> None:
    np.save(tmp_path / "mug.npy", seen)
    done = here(
        "predict", "input=mug.npy", f"model={small}/outputs/train/latest", "proposing.point_support=2", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    run = tmp_path / "outputs/predict/latest"
    grasps = read_grasps(run / "grasps.json")
    assert grasps and "Ranked grasps" in done.stdout and f"{len(grasps)} grasps (" in done.stdout
    assert len(read_isaac(run / "isaac_grasp.yaml").grasps) == len(read_graspnet(run / "graspnet.npy")) == len(grasps)
    assert len(json.loads((run / "moveit_grasps.json").read_text())["grasps"]) == len(grasps)
    assert 5e5 < (run / "index.html").stat().st_size < 1.5e6 and (run / "grasps.png").read_bytes()[1:4] == b"PNG"
    near = [np.linalg.norm(seen[:, :3] - g.T_input_tcp[:3, 3], axis=1).min() for g in grasps]
    assert max(near) < 0.06  # m: every grasp is about the mug


def test_predict_says_why_there_is_no_grasp_and_which_target_is_whose(
    small: Path, seen: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    model = f"model={small}/outputs/train/latest"
    np.savetxt("line.xyz", np.linspace([0.1, 0, 0.5], [0.3, 0, 0.5], 300))
    Path("none").mkdir()
    predict(typed(PredictConfig, composed("predict", "input=line.xyz", "viewpoints=[0,0,0]", model)), Path("none"))
    assert "no grasp: the points lie on one line, which shows no surface" in capsys.readouterr().out
    assert read_grasps(Path("none/grasps.json")) == [] and not Path("none/index.html").exists()
    two = np.concatenate([seen, seen + np.array([0.3, 0, 0, 0, 0, 0])])
    np.save("two.npy", two)
    np.save("labels.npy", np.repeat([4, 9], len(seen)))
    Path("both").mkdir()
    both = composed("predict", "input=two.npy", "segments=labels.npy", "proposing.point_support=2", model)
    predict(typed(PredictConfig, both), Path("both"))
    out = capsys.readouterr().out
    assert "targets: 4 (" in out and "target" in out.split("prototypes")[1].splitlines()[0]
    grasps = read_grasps(Path("both/grasps.json"))
    assert {grasp.target for grasp in grasps} == {4, 9}
    for grasp in grasps:
        own = seen[:, :3] + np.array([0.3 * (grasp.target == 9), 0, 0])
        assert np.linalg.norm(own - grasp.T_input_tcp[:3, 3], axis=1).min() < 0.06


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["input=nowhere.ply"], ["nowhere.ply"]),
        (["input=mm.npy"], ["mm.npy", "unit"]),
        (["input=bare.npy"], ["viewpoints"]),
        (["input=bare.npy", "model=nowhere"], ["model: ", "latest or a folder, got nowhere"]),
    ],
)
def test_predict_refuses_bad_input(
    small: Path,
    seen: np.ndarray,
    tmp_path: Path,
    overrides: list[str],
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save(tmp_path / "mm.npy", seen * np.array([1000, 1000, 1000, 1, 1, 1]))
    np.save(tmp_path / "bare.npy", seen[:, :3])
    model = [] if any(o.startswith("model=") for o in overrides) else [f"model={small}/outputs/train/latest"]
    says(predict, PredictConfig, words, "predict", *overrides, *model)


def test_a_model_in_python_gives_the_grasps_of_the_command(small: Path, seen: np.ndarray) -> None:
    model = spgf_torch.load(small / "outputs/train/latest")
    texlets = model.texlets(seen[:, :3], normals=seen[:, 3:])
    grasps = model.predict(texlets, top=5)
    assert 5 <= len(grasps) <= 10 and {g.type for g in grasps} <= {"NPG", "WPG"} and len(model.names) == 4
    for g in grasps:
        assert np.allclose(g.T_input_pregrasp[:3, 3], g.T_input_tcp[:3, 3] - 0.1 * g.T_input_tcp[:3, 2])
        assert np.allclose(np.linalg.inv(g.T_input_base) @ g.T_input_tcp, model.grippers[g.type].T_base_tcp)
    low = model.predict(texlets, top=5, plane=np.array([0.0, 0.0, 1.0, 10.0]))  # a table 10 m below changes nothing
    assert np.allclose(low[0].T_input_tcp, grasps[0].T_input_tcp)
    assert model.predict(texlets, top=5, plane=np.array([0.0, 0.0, 1.0, -10.0])) == []  # all is below this one
    with pytest.raises(InputError, match="points: expected an array of numbers, got str"):
        model.texlets("cloud.ply")
    with pytest.raises(InputError, match="viewpoints: expected an array of numbers"):
        model.texlets(seen[:, :3], viewpoint="left")


def test_a_hand_keeps_out_of_what_stands_beside_and_below(small: Path, seen: np.ndarray) -> None:
    """A wall 40 mm beside the object's middle, a table, and the way from below, each with and without."""
    model = spgf_torch.load(small / "outputs/train/latest")
    side = np.arange(-0.2, 0.2, 0.004)
    y, z = (part.ravel() for part in np.meshgrid(side, side))
    middle = seen[:, :3].mean(axis=0)
    wall = np.column_stack([np.full(len(y), seen[:, 0].max() + 0.04), middle[1] + y, middle[2] + z])
    points, normals = (
        np.concatenate([seen[:, :3], wall]),
        np.concatenate([seen[:, 3:], np.tile([-1.0, 0, 0], (len(wall), 1))]),
    )
    marked = np.arange(len(points)) < len(seen)
    alone = model.predict(
        spgf_torch.Scene.from_points(seen[:, :3], normals=seen[:, 3:], sensing=model.sensing, gravity=None)
    )
    scene = spgf_torch.Scene.from_points(points, normals=normals, mask=marked, sensing=model.sensing, gravity=None)

    def in_the_wall(grasps: list) -> int:
        shapes = [
            (g, s.vertices @ g.T_input_tcp[:3, :3].T + g.T_input_tcp[:3, 3])
            for g in grasps
            for s in model.grippers[g.type].shapes
        ]
        return len({id(g) for g, corners in shapes if corners[:, 0].max() > wall[0, 0]})

    beside = model.predict(scene)
    assert in_the_wall(alone) > 2 and len(beside) > 5 and in_the_wall(beside) == 0
    rising = [g.T_input_tcp[2, 2] > np.sin(np.deg2rad(10.01)) for g in alone]
    upright = spgf_torch.Scene.from_points(seen[:, :3], normals=seen[:, 3:], sensing=model.sensing)
    assert any(rising) and not any(g.T_input_tcp[2, 2] > np.sin(np.deg2rad(10.01)) for g in model.predict(upright))
    with pytest.raises(InputError, match="scene: expected a Scene or Texlets, got ndarray"):
        model.predict(seen[:, :3])  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"table: expected with spgf_torch\.Scene\.from_points"):
        model.texlets(seen[:, :3], normals=seen[:, 3:], table="find")


def test_moved_points_give_the_same_grasps_moved(small: Path, seen: np.ndarray) -> None:
    """Nine in ten within 1 mm and 1 deg: rounding may put a neighbour into the next cell of a ring."""
    model = spgf_torch.load(small / "outputs/train/latest")
    T = np.array([[0.36, 0.48, -0.8, 0.4], [-0.8, 0.6, 0, -0.3], [0.48, 0.64, 0.6, 0.8], [0, 0, 0, 1]])
    R, t = T[:3, :3], T[:3, 3]
    still = model.predict(model.texlets(seen[:, :3], normals=seen[:, 3:]))
    moved = model.predict(model.texlets(seen[:, :3] @ R.T + t, normals=seen[:, 3:] @ R.T))
    assert len(still) >= 10
    found = [any(a.type == b.type and near(T @ a.T_input_tcp, b.T_input_tcp) for b in moved) for a in still]
    assert np.mean(found) >= 0.9
    assert near(T @ still[0].T_input_tcp, moved[0].T_input_tcp)


def near(a: np.ndarray, b: np.ndarray) -> bool:
    """Within 1 mm and 1 deg."""
    cosine = (np.trace(a[:3, :3].T @ b[:3, :3]) - 1) / 2
    return bool(np.linalg.norm(a[:3, 3] - b[:3, 3]) < 1e-3 and np.degrees(np.arccos(np.clip(cosine, -1, 1))) < 1)


def test_the_live_loop_finds_grasps_in_every_frame(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(ROOT / "docs/live_loop.py"))["main"](str(small / "outputs/train/latest"), 2)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 and all("texlets" in line and "holds with probability" in line for line in lines)
