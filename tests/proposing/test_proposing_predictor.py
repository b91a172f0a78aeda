"""The model in Python: which proposals a caller keeps, what goes with grasps, and many threads at once."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from asymmetric import GRIPPERS
from commands import ROOT
from proposing_models import CONFIG, VOLUMES, learned

import spgf_torch
from spgf_torch.errors import InputError
from spgf_torch.hands.records import Grasp
from spgf_torch.predictor import Predictor, block
from spgf_torch.proposing.proposals import Proposals
from spgf_torch.proposing.propose import Proposer
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings

JUDGE = ROOT / "data/models/panda"
THREADS = 8

bare = Predictor(None, settings(SensingConfig), GRIPPERS, None, 0.1)


def proposals() -> Proposals:
    """Six, best first: W N W N W N (their codes: N 0, W 1), of probability 0.9, 0.8, ... 0.4."""
    kinds, falling = torch.tensor([1, 0, 1, 0, 1, 0]), torch.tensor([0.9, 0.8, 0.7, 0.6, 0.5, 0.4])
    T = torch.eye(4).repeat(6, 1, 1)
    T[:, 0, 3] = torch.arange(6) / 10
    return Proposals(T, kinds, ("NPG", "WPG"), falling, falling, kinds, ((),) * 6)


def places(grasps: list[Grasp]) -> list[int]:
    """Which of the proposals they are."""
    return [round(10 * float(grasp.T_input_tcp[0, 3])) for grasp in grasps]


def test_what_is_kept_fills_the_places_of_what_is_not() -> None:
    assert places(bare.grasps(proposals(), 2)) == [0, 1, 2, 3]
    assert places(bare.grasps(proposals(), 2, lambda grasp: grasp.T_input_tcp[0, 3] > 0.05)) == [1, 2, 3, 4]
    assert places(bare.grasps(proposals(), 2, lambda grasp: np.bool_(grasp.type == "NPG"))) == [1, 3]


def test_it_is_asked_best_first_and_no_more_than_needed() -> None:
    """One of each type is wanted; it refuses the best W: W, N, W are looked at, and no more."""
    asked: list[int] = []

    def keep(grasp: Grasp) -> bool:
        asked.append(places([grasp])[0])
        return asked[-1] != 0

    assert places(bare.grasps(proposals(), 1, keep, target=3)) == [1, 2] and asked == [0, 1, 2]
    assert {grasp.target for grasp in bare.grasps(proposals(), 1, keep, target=3)} == {3}


@pytest.mark.parametrize("said", [None, 1, "yes", np.array([True])])
def test_an_answer_is_true_or_false(said: Any) -> None:
    with pytest.raises(InputError, match="keep: expected True or False of each grasp, got"):
        bare.grasps(proposals(), 1, lambda _: said)


def test_an_error_in_it_is_the_callers() -> None:
    with pytest.raises(ZeroDivisionError):
        bare.grasps(proposals(), 1, lambda grasp: bool(1 // int(grasp.score > 2)))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: spgf_torch.load(3), "model: expected the name of a model or a folder, got 3"),
        (
            lambda: spgf_torch.load("panda", judge=["x"]),
            r"judge: expected the name of a model or a folder, got \['x'\]",
        ),
        (lambda: spgf_torch.load("panda", proposing=3), "proposing: expected one of clutter, particles; got 3"),
        (lambda: spgf_torch.load_hand_file(3), "3: expected the path of a file or folder, got int"),
        (lambda: bare.predict(block(0.005), top="3"), "top: expected a whole number from 1, got '3'"),
        (lambda: bare.predict(block(0.005), plane=[0, 0, 1]), r"plane: expected 4 finite numbers, got \[0, 0, 1\]"),
        (lambda: bare.predict(block(0.005), plane="find"), "plane: expected 4 numbers, got 'find'"),
        (lambda: bare.predict(np.zeros((9, 3))), "scene: expected a Scene or Texlets, got ndarray"),
        (
            lambda: spgf_torch.Scene.from_points(np.ones((9, 3)), sensing=3),
            r"sensing: expected a model's \(model\.sensing\), got 3",
        ),
    ],
)
def test_values_of_another_type_are_told(call: Callable[[], Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()


def by_votes() -> Predictor:
    """A model of votes that has looked at nothing yet."""
    model = learned(torch.Generator().manual_seed(3))
    return Predictor(model, settings(SensingConfig), GRIPPERS, Proposer.of(model, CONFIG, VOLUMES), 0.1)


def by_judge() -> Predictor:
    return Predictor.load(JUDGE)


needs_judge = pytest.mark.skipif(not (JUDGE / "judge.json").is_file(), reason="no shipped judge: make judges")


@pytest.mark.parametrize("fresh", [by_votes, pytest.param(by_judge, marks=needs_judge)])
def test_many_threads_get_what_one_gets(fresh: Callable[[], Predictor]) -> None:
    """All begin at once, with a model that has built nothing; torch's number of threads stays what it was."""
    spacing, sizes = settings(SensingConfig).spacing, (0.03, 0.035, 0.04)
    things, alone = [block(spacing, size) for size in sizes], fresh()
    expected = [alone.predict(thing, top=3).to_dict() for thing in things]
    assert any(each["grasps"] for each in expected)
    shared, together, before = fresh(), threading.Barrier(THREADS), torch.get_num_threads()

    def ask(i: int) -> dict[str, Any]:
        together.wait()
        return shared.predict(things[i % len(things)], top=3).to_dict()

    with ThreadPoolExecutor(THREADS) as pool:
        got = list(pool.map(ask, range(THREADS)))
    assert got == [expected[i % len(things)] for i in range(THREADS)]
    with ThreadPoolExecutor(1) as later:
        assert later.submit(torch.get_num_threads).result() == torch.get_num_threads() == before


@needs_judge
def test_grasps_of_a_model_save_and_show_their_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the frame of the scene, also where the grasps were moved to another; the file follows the grasps."""
    model, opened = by_judge(), list[str]()
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or True)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("time.strftime", lambda *_: "2026-11-30 00:00")  # the pages may be of two minutes
    T = np.eye(4)
    T[0, 3] = 1.0
    grasps = model.predict(block(model.sensing.spacing), top=1, plane=np.array([0.0, 0.0, 1.0, 0.3]))
    moved = grasps.transform(T)
    pages = [moved.show(), *grasps.save(tmp_path / "there", "page")]
    assert opened == [pages[0].as_uri()] and [page.name for page in pages] == ["index.html", "index.html", "grasps.png"]
    assert pages[0].read_bytes() == pages[1].read_bytes()
    assert moved.to_dict()["grasps"][0]["T_input_tcp"][0][3] == pytest.approx(1 + grasps[0].T_input_tcp[0, 3])
    assert grasps.judge is not None and grasps.judge["folder"] == str(JUDGE)
