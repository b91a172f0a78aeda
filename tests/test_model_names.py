"""A model's name: the user's own before the shipped ones; a path stays a path; `latest` must be said."""

from pathlib import Path

import pytest
from commands import ROOT

from spgf_torch.errors import InputError
from spgf_torch.files.given_paths import check_model, check_place, known_models, model_and_judge, model_folder


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a model `mine` of votes and judge, and a folder `plain` without a model."""
    for name in ("model.json", "model.safetensors", "judge.json", "judge.safetensors"):
        made(tmp_path / "models/mine" / name)
    (tmp_path / "plain").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def made(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("{}")
    return path


def test_names_of_own_and_shipped_models(place: Path) -> None:
    assert model_folder("mine") == Path("models/mine")
    assert model_folder("panda") == ROOT / "data/models/panda"
    assert {"mine", "panda", "sdh2"} <= known_models().keys()


def test_a_path_stays_a_path(place: Path) -> None:
    assert model_folder("./plain") == Path("./plain") and model_folder("plain") == Path("plain")
    assert model_folder("models/none") == Path("models/none")
    assert model_folder(Path("panda")) == Path("panda")
    assert model_folder("data/models/panda") == ROOT / "data/models/panda"
    assert model_folder("latest") == Path("outputs/train/latest")


def test_votes_and_judge_by_name(place: Path) -> None:
    own = Path("models/mine")
    assert model_and_judge("mine", None) == (own, own) and model_and_judge("mine", "none") == (own, None)
    assert model_and_judge("none", "mine") == (None, own)
    check_model("prototypes_from", "mine")
    with pytest.raises(
        InputError, match=r"^prototypes_from: expected a model \(.*\), latest or a folder, got mien; did"
    ):
        check_model("prototypes_from", "mien")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (None, r"^model: expected hand=NAME for a shipped model \(.*panda.*\), .*model=latest .*; got none$"),
        ("", r"^model: expected hand=NAME .*; got none$"),
        ("pnada", r"^model: expected a model \(.*mine.*\), latest or a folder, got pnada; did you mean panda\?$"),
        ("lates", "did you mean latest"),
        ("qqqq", "got qqqq$"),
    ],
)
def test_what_is_no_model(given: str | None, words: str, place: Path) -> None:
    with pytest.raises(InputError, match=words) as refused:
        model_folder(given)
    assert "\n" not in str(refused.value)


def test_a_word_that_means_two_models_is_refused(place: Path) -> None:
    made(place / "panda/model.json")
    with pytest.raises(InputError, match=r"^model: expected one model, got two: \./panda and .*; model=\./panda is"):
        model_folder("panda")
    assert model_folder("./panda") == Path("./panda")


def test_a_shipped_name_is_no_name_for_ones_own(place: Path) -> None:
    """Else a robot may get another hand's grasps: neither is it given, nor is one taken that was put there."""
    with pytest.raises(InputError, match=r"^name: expected a name of your own, not that of .*\(panda, .*; got panda$"):
        check_place("panda", replace=True)
    made(place / "models/panda/judge.json")
    with pytest.raises(
        InputError, match=r"^model: expected one model, got two: models/panda and .*; model=models/panda is"
    ):
        model_folder("panda")
    assert model_folder("models/panda") == Path("models/panda")
