"""Every case has a working folder of its own; what its reader imports is not counted as its time and memory."""

from pathlib import Path

import pytest
from hostile import model_document


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def model_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The settings of the model are there, read and checked: tables of models have their own cases."""
    monkeypatch.setattr("spgf_torch.predict.model_and_judge", lambda model, judge: (Path(model), None))
    monkeypatch.setattr("spgf_torch.predictor.model_settings", lambda folder: model_document()["settings"])


@pytest.fixture(scope="session", autouse=True)
def imported() -> None:
    import matplotlib.figure  # noqa: F401
    import plotly  # noqa: F401
    import pytorch_kinematics  # noqa: F401

    import spgf_torch.predictor
    import spgf_torch.reporting.pages.build
    import spgf_torch.scene.scene  # noqa: F401
