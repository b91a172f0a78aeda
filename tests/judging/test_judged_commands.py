"""What `predict` and `evaluate` do with a judge, and what they refuse."""

import json
import re
import shutil
import sys
from collections.abc import Sequence
from contextlib import chdir, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import trimesh
from composing import composed
from judges import quick_judge, saved

import spgf_torch
from spgf_torch.errors import InputError
from spgf_torch.evaluate import _known, known_lines
from spgf_torch.evaluate import run as evaluate
from spgf_torch.experiment.config import EvaluateConfig, TrainConfig
from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.extras import PACKAGES
from spgf_torch.formats.grasps_json import read_grasps
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.records import Grasp
from spgf_torch.predict import run as predict
from spgf_torch.predictor import Predictor
from spgf_torch.proposing.closing_region import closing_region
from spgf_torch.proposing.judge import load_judge
from spgf_torch.proposing.judge_features import NAMES as NUMBERS
from spgf_torch.proposing.judge_features import Seen, judge_features
from spgf_torch.proposing.judge_proposer import JudgedProposer
from spgf_torch.scene.config import PredictConfig
from spgf_torch.scene.depth import pixel_points
from spgf_torch.scene.scene import Scene
from spgf_torch.sensing.cameras import Camera, cast, intrinsics, look_at
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings, typed
from spgf_torch.train import run as train

ROOT = Path(__file__).parents[2]
NAMES = ("bowl_sugar", "jar_jam", "tumbler", "soap_bar", "box_tea", "egg")
SMALL = ["K=3", "folds=2", "bootstrap=100", "sensing.width=160", "sensing.height=120", "sensing.focal=144"]
SMALL += ["affordance.features_per_object=40", "prototypes.restarts=1", "prototypes.subsample=1000", "inner_grasps=100"]
TINY = {"candidates": 12, "rounds": 1, "best": 1, "random": 1, "one_view": 1, "four_views": 0, "hypotheses.seeds": 6}
TINY |= {"hypotheses.hypotheses": 60, "learning.trees": 5, "learning.least": 3}
LEARN = ["judge=learn", *(f"+judging.{key}={value}" for key, value in TINY.items())]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder: a tiny model of the SDH-2 with a judge, judges of two hands, a mesh, a depth image of it."""
    folder = tmp_path_factory.mktemp("judged")
    for name in ("objects", "trials", "scans"):
        (folder / name).mkdir()
    for name in NAMES:
        shutil.copy(ROOT / f"data/objects/{name}.yaml", folder / "objects")
        shutil.copy(ROOT / f"data/trials/{name}.parquet", folder / "trials")
    shutil.copy(ROOT / "data/trials/config.yaml", folder / "trials")
    run, told = folder / "outputs/train/latest", StringIO()
    run.mkdir(parents=True)
    with chdir(folder), redirect_stdout(told):
        settled = composed("train", "objects=objects", "trials=trials", "workers=1", *SMALL, *LEARN)
        train(typed(TrainConfig, settled), run)
    (folder / "stdout.txt").write_text(told.getvalue())
    (folder / "alone").mkdir()
    for name in ("judge.json", "judge.safetensors"):
        shutil.copy(run / name, folder / "alone")
    saved(quick_judge(), folder / "judge")
    saved(quick_judge("panda"), folder / "panda")
    saved(quick_judge(sure=1.0), folder / "doubting")
    block = trimesh.creation.box((0.05, 0.06, 0.08)).subdivide().subdivide()
    block.apply_translation((0, 0, 0.04))
    block.export(folder / "scans/block.ply")
    (folder / "scans/manifest.csv").write_text("name,file,class\nblock,block.ply,box\n")
    depth, camera = image(block)
    np.save(folder / "depth.npy", depth)
    np.savetxt(folder / "K.txt", camera.K)
    np.savetxt(folder / "pose.txt", camera.T_object_camera)
    return folder


def image(block: trimesh.Trimesh) -> tuple[np.ndarray, Camera]:
    table = trimesh.creation.box((0.8, 0.8, 0.02))
    table.apply_translation((0, 0, -0.01))
    config = settings(SensingConfig)
    camera = Camera(intrinsics(config), look_at(np.array([0.4, 0.1, 0.45]), np.array([0, 0, 0.04])), 320, 240)
    return cast(trimesh.util.concatenate([block, table]), camera)[0], camera


DEPTH = ["input=depth.npy", "intrinsics=K.txt", "poses=pose.txt", "table=find", "model=outputs/train/latest"]


def test_predict_ranks_by_the_judge(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    monkeypatch.chdir(place)
    run = tmp_path
    predict(typed(PredictConfig, composed("predict", *DEPTH, "judge=judge", "N=5")), run)
    told = capsys.readouterr().out
    assert "judge: " in told and "unseen space from 1 depth image" in told
    grasps = read_grasps(run / "grasps.json")
    said = [grasp.probability for grasp in grasps]
    for grasp in grasps:
        assert grasp.judged is not None and grasp.probability == pytest.approx(np.prod(grasp.judged), abs=1e-6)
    page = (run / "index.html").read_text()
    content = json.loads(re.search(r'<script type="application/json" id="content">(.*?)</script>', page)[1])  # type: ignore[index]
    assert len(content["grasps"]) == len(grasps) and content["table"] and content["votes"]
    for shown, grasp in zip(content["grasps"], grasps, strict=True):
        assert shown["judged"] == pytest.approx(grasp.judged, abs=1e-3)
        assert all(number["usual"] and number["moved"] for number in shown["weighed"])
    assert any(shown["weighed"] for shown in content["grasps"])
    assert len(grasps) >= 5 and said == sorted(said, reverse=True) and (run / "index.html").is_file()
    assert min(grasp.T_input_tcp[2, 3] for grasp in grasps) > 0.0  # above the table


def test_train_leaves_a_model_with_its_judge(place: Path) -> None:
    run = place / "outputs/train/latest"
    judge, results = load_judge(run), json.loads((run / "results.json").read_text())
    assert set(judge.taught) == set(NAMES) and judge.settings["sensing"]["width"] == 160
    assert results["judge"]["trials"] == judge.results["trials"] and results["success_rate"]
    assert "Judge of grasp hypotheses" in (run / "JUDGE.md").read_text() and (run / "README.md").is_file()
    assert {path.stem for path in (run / "own_trials").iterdir()} == set(NAMES)
    assert not (run / "trials").exists()  # they were given
    told = (place / "stdout.txt").read_text()
    assert "judge=none" in told and "Held in SAPIEN" in told


def test_a_model_that_carries_a_judge_is_ranked_by_it(place: Path) -> None:
    """With judge=none by the votes; a judge alone proposes the same without a model."""
    run, alone = place / "outputs/train/latest", place / "alone"
    depth, camera = image(trimesh.load_mesh(place / "scans/block.ply"))
    scene = Scene.from_depth(depth, camera.K, camera.T_object_camera, table="find")
    own, by_itself = Predictor.load(run), spgf_torch.load(alone)
    found, same = own.predict(scene, top=3), by_itself.predict(scene, top=3)
    assert own.judged and [g.probability for g in found] == [g.probability for g in same]
    assert all(np.array_equal(a.T_input_tcp, b.T_input_tcp) for a, b in zip(found, same, strict=True))
    assert by_itself.model is None and all(not grasp.voted_by for grasp in same)
    assert Predictor.load(run, judge="none").judged is None and Predictor.load("none", judge=alone).model is None


def test_predict_tells_what_ranks(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    monkeypatch.chdir(place)
    predict(typed(PredictConfig, composed("predict", *DEPTH, "model=alone", "N=3")), tmp_path)
    told = capsys.readouterr().out
    assert "which ranks" in told and "model: " not in told and (tmp_path / "index.html").is_file()


def test_a_bare_cloud_is_told_that_unseen_space_is_not_known(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(place)
    block = trimesh.load_mesh("scans/block.ply")
    points, faces = block.sample(6000, return_index=True, seed=0)
    np.save("cloud.npy", np.hstack([points, block.face_normals[faces]]))
    Path("bare").mkdir()
    config = composed("predict", "input=cloud.npy", "model=outputs/train/latest", "judge=doubting", "N=3")
    predict(typed(PredictConfig, config), Path("bare"))
    told = capsys.readouterr().out
    assert "without unseen space" in told and "nothing sure" in told
    head = json.loads(Path("bare/grasps.json").read_text())["judge"]
    assert not head["unseen_space"] and "without unseen space" in head["known"] and head["nothing_sure"]
    page = Path("bare/index.html").read_text()
    assert "without unseen space" in page and "nothing sure" in page
    Path("posed").mkdir()
    seen = composed("predict", "input=cloud.npy", "viewpoints=[[0.4,0.1,0.45]]", "model=outputs/train/latest")
    predict(typed(PredictConfig, seen | {"judge": "judge", "N": 3}), Path("posed"))
    assert "hidden from the 1 viewpoint given" in capsys.readouterr().out  # the block was sampled on all sides


def test_a_cloud_with_its_viewpoint_tells_unseen_space(place: Path) -> None:
    """Points of the depth image, and the camera's place: the judge says nearly the same as with the image."""
    model = spgf_torch.load(place / "outputs/train/latest", judge=place / "judge")
    depth, camera = image(trimesh.load_mesh(place / "scans/block.ply"))
    eye = camera.T_object_camera[:3, 3]
    points = pixel_points(depth, camera)[depth > 0]
    by_image = Scene.from_depth(depth, camera.K, camera.T_object_camera, table=[0, 0, 1, 0])
    by_cloud = Scene.from_points(points, eye, table=[0, 0, 1, 0], sensing=model.sensing)
    assert by_cloud.views is not None and "1 viewpoint" in by_cloud.unseen
    assert model.judged is not None
    search, texlets = model.judged.search, by_image.texlets
    hypotheses = search.hypotheses(texlets, model.surroundings(by_image))
    numbers = [judge_features(Seen(texlets, s.views or ()), hypotheses, search) for s in (by_image, by_cloud)]
    worst = NUMBERS.index("worst_finger")
    assert numbers[0][:, worst].max() > 0.5 and (numbers[0] - numbers[1])[:, worst].abs().mean() < 0.03


def test_nothing_is_gripped_where_a_crop_box_cuts(place: Path) -> None:
    """Half a plate is the target: its cut side looks like an edge. Without the border hands come over it."""
    plate = trimesh.creation.box((0.3, 0.1, 0.01))
    plate.apply_translation((0, 0, 0.08))
    depth, camera = image(plate)
    box = {"crop_low": [-0.04, -1, 0.07], "crop_high": [0.04, 1, 0.1]}
    scene = Scene.from_depth(depth, camera.K, camera.T_object_camera, table=[0, 0, 1, 0], **box)
    for judge in (place / "judge", None):
        model = spgf_torch.load(place / "outputs/train/latest", judge=judge)
        bare = replace(scene, borders=None)
        with_border, without = (over_the_cut(model.predict(s, top=20)) for s in (scene, bare))
        assert with_border == 0 and (without > 0 or judge is None), (judge, without)


def over_the_cut(grasps: Sequence[Grasp]) -> int:
    """How many hands have the plane x = 40 or -40 mm of the plate between their fingers, behind the pads."""
    pads = {name: closing_region(volume).low for name, volume in open_hand(settings(HandConfig)).items()}
    edge = np.array([[x, y, 0.085] for x in (-0.04, 0.04) for y in np.linspace(-0.05, 0.05, 40)])
    count = 0
    for grasp in grasps:
        at = (edge - grasp.T_input_tcp[:3, 3]) @ grasp.T_input_tcp[:3, :3]
        low, high = np.array([-0.01, -0.005, -0.04]), np.array([0.01, 0.005, pads[grasp.type]])
        count += bool(((at > low) & (at < high)).all(1).any())
    return count


def test_a_judge_in_python(place: Path) -> None:
    """The grasps of the judge; a scene of depth images tells it more than its points alone."""
    model = spgf_torch.load(place / "outputs/train/latest", judge=place / "judge")
    depth, camera = image(trimesh.load_mesh(place / "scans/block.ply"))
    scene = Scene.from_depth(depth, camera.K, camera.T_object_camera, table="find")
    assert scene.views is not None and len(scene.views) == 1
    grasps = model.predict(scene, top=5)
    bare = model.predict(scene.texlets, top=5, plane=scene.table)
    assert (
        grasps
        and bare
        and any(
            not np.allclose(a.T_input_tcp, b.T_input_tcp) or a.probability != b.probability
            for a, b in zip(grasps, bare, strict=False)
        )
    )
    assert isinstance(model.judged, JudgedProposer)
    plain = spgf_torch.load(place / "outputs/train/latest", judge="none")
    assert plain.judged is None and all(grasp.judged is None for grasp in plain.predict(scene.texlets, top=5))


def test_evaluate_executes_what_the_judge_ranks(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(place)
    few = ["objects=scans", "random_trials=3", "N=3", "bootstrap=100", "workers=1", "model=outputs/train/latest"]
    Path("judged").mkdir()
    evaluate(typed(EvaluateConfig, composed("evaluate", *few, "judge=judge", "table=true")), Path("judged"))
    found = json.loads(Path("judged/results.json").read_text())["judged"]
    assert json.loads(Path("judged/results.json").read_text())["learned_from"] == 0
    assert found["judge"] == "judge" and found["table"] and 0 <= found["top_N"] <= 1 and 0 <= found["ece"] <= 1
    Path("votes").mkdir()
    evaluate(typed(EvaluateConfig, composed("evaluate", *few, "table=true", "judge=none")), Path("votes"))
    results = json.loads(Path("votes/results.json").read_text())
    assert results["judged"]["judge"] is None and "ece" not in results["judged"]
    Path("by itself").mkdir()
    evaluate(typed(EvaluateConfig, composed("evaluate", *few[:-1], "model=alone")), Path("by itself"))
    assert json.loads(Path("by itself/results.json").read_text())["judged"]["judge"] == "alone"


def test_rates_on_objects_that_taught_the_judge_are_told_to_be_none_of_novel_ones() -> None:
    """The model's own objects do not matter where the judge ranks."""
    egg, box = SimpleNamespace(digest="an egg's"), SimpleNamespace(digest="a box's")
    judge, model = quick_judge(taught={"another name": egg.digest}), SimpleNamespace(settings={"taught": {}})
    config = typed(EvaluateConfig, composed("evaluate", "objects=scans"))
    assert _known([egg, box], model, judge, config) == 1 and _known([box], model, judge, config) == 0  # type: ignore[arg-type]
    line = known_lines(1, judge, 2)[0]
    assert line.startswith("not novel: the judge learned from 1 of these 2 objects") and known_lines(0, judge, 2) == []
    model.settings = {"taught": {"box_tea": box.digest}}
    assert _known([egg, box], model, None, config) == 1 and "held_out=true" in known_lines(1, None, 2)[0]  # type: ignore[arg-type]
    assert _known([egg, box], model, None, replace(config, held_out=True)) == 0  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("command", "overrides", "words"),
    [
        ("evaluate", ["judge=nowhere"], ["judge: expected a model", "got nowhere"]),
        ("evaluate", ["judge=judge", "candidates=sampled"], ["judge", "candidates=proposed"]),
        ("evaluate", ["table=true", "candidates=sampled"], ["table", "candidates=proposed"]),
        ("evaluate", ["judge=judge", "held_out=true"], ["judge=", "held_out", "README.md"]),
        ("evaluate", ["judge=./panda"], ["judge", "sdh2", "panda", "python -m spgf_torch.judge hand=sdh2"]),
        ("predict", ["judge=nowhere"], ["judge", "nowhere"]),
        ("predict", ["judge=./panda"], ["judge", "the model's hand", "panda"]),
        ("predict", ["judge=scans"], ["judge.json", "scans"]),
        ("predict", ["model=none"], ["judge", "model=none"]),
        ("predict", ["model=alone", "judge=none"], ["judge", "model=alone"]),
        ("predict", ["model=nowhere", "judge=judge"], ["model: expected a model", "got nowhere"]),
    ],
)
def test_what_does_not_go_together_is_refused(
    place: Path, command: str, overrides: list[str], words: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(place)
    given = ["objects=scans", "model=outputs/train/latest"] if command == "evaluate" else DEPTH
    run, kind = (evaluate, EvaluateConfig) if command == "evaluate" else (predict, PredictConfig)
    with pytest.raises(InputError) as error:
        run(typed(kind, composed(command, *given, *overrides)), tmp_path)  # type: ignore[arg-type]
    assert "\n" not in str(error.value) and all(word in str(error.value) for word in words), error.value
    assert not list(tmp_path.iterdir())


def test_the_quick_judge_is_no_constant() -> None:
    said = quick_judge().probability(torch.rand(50, 31, generator=torch.Generator().manual_seed(1)), True)
    assert said.std() > 0.05


def test_predict_gives_its_grasps_without_any_extra(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """All packages that extras bring are missing; the page needs none of them."""
    monkeypatch.chdir(place)
    for package in PACKAGES:
        monkeypatch.setitem(sys.modules, package, None)
    Path("lean").mkdir()
    predict(typed(PredictConfig, composed("predict", *DEPTH, "judge=judge", "N=5")), Path("lean"))
    said = " ".join(capsys.readouterr().out.split())
    assert "files and page in lean" in said
    assert len(read_grasps(Path("lean/grasps.json"))) >= 5
    assert Path("lean/grasps.png").is_file()
    page = Path("lean/index.html").read_text()
    assert page.count('<button type="button" aria-pressed="false">') == len(read_grasps(Path("lean/grasps.json")))
