"""The names that people import from the package: all there and typed."""

import re

import pytest
import yaml
from commands import ROOT

import spgf_torch


@pytest.mark.parametrize("name", spgf_torch.__all__)
def test_every_public_name_is_there(name: str) -> None:
    found = getattr(spgf_torch, name)
    assert name == "__version__" or found.__name__.rpartition(".")[2] == name  # train is a module that can be called
    assert name in dir(spgf_torch)


def test_what_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'spgf_torch' has no attribute 'predict_all'"):
        spgf_torch.predict_all  # noqa: B018


def test_type_information_is_exported() -> None:
    assert (ROOT / "spgf_torch/py.typed").is_file()


def test_one_version() -> None:
    """pyproject.toml reads that of the package; who cites it finds the same."""
    project = (ROOT / "pyproject.toml").read_text()
    assert 'dynamic = ["version"]' in project and not re.search(r"^version =", project, re.MULTILINE)
    assert str(yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"]) == spgf_torch.__version__
