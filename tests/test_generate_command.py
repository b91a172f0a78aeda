"""`python -m spgf_torch.generate`: what it writes, that nothing is overwritten, and how it ends."""

from __future__ import annotations

from pathlib import Path

import pytest
from commands import here
from composing import composed
from matplotlib.image import imread

from spgf_torch.errors import InputError
from spgf_torch.generate import run
from spgf_torch.objects.config import GenerateConfig
from spgf_torch.objects.library import load_objects
from spgf_torch.settings import typed


def settings(**changes: object) -> GenerateConfig:
    return typed(GenerateConfig, {**composed("generate"), **changes})  # type: ignore[dict-item]


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.yaml")}


def test_a_folder_of_descriptions_that_a_larger_one_contains(tmp_path: Path) -> None:
    run(settings(count=12, seed=3, out=str(tmp_path / "few"), pictured=0), tmp_path)
    run(settings(count=20, seed=3, out=str(tmp_path / "deep/many"), pictured=1), tmp_path)
    few, many = contents(tmp_path / "few"), contents(tmp_path / "deep/many")
    assert (len(few), len(many)) == (12, 20) and few.items() <= many.items()
    assert {path.name for path in (tmp_path / "few").iterdir()} == {*few, "README.md"}
    assert {item.name for item in load_objects(tmp_path / "few")} == {name.removesuffix(".yaml") for name in few}
    assert imread(tmp_path / "deep/many/contact_sheet.png").shape[0] == 187  # a row of 2.2 inches at 85 dpi
    about = (tmp_path / "few/README.md").read_text()
    assert about.startswith("# 12 household objects") and "count=12 seed=3 ranges=conf/sizes/household.yaml" in about
    assert sorted(path.name for path in tmp_path.iterdir()) == ["deep", "few"]


def test_nothing_is_overwritten_and_nothing_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    run(settings(count=1, out=str(mine), pictured=0, families=["egg"]), tmp_path)
    before = contents(mine)
    with pytest.raises(InputError, match=r"out: expected a new or an empty folder, got .*mine, one that is not empty"):
        run(settings(count=1, out=str(mine)), tmp_path)
    assert contents(mine) == before and [*before] == ["egg_0_0000.yaml"]
    monkeypatch.setattr("spgf_torch.objects.contact_sheet.contact_sheet", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run(settings(count=1, out=str(tmp_path / "new")), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_as_a_command(tmp_path: Path) -> None:
    """Without out the objects are in the run's folder."""
    done = here("generate", "count=3", "families=[mug,soap]", "pictured=1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "3 objects of 2 families" in done.stdout
    objects = tmp_path / "outputs/generate/latest/objects"
    assert len(contents(objects)) == 3 and (objects / "contact_sheet.png").exists()


def test_masses_in_the_wrong_order(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^lightest: expected less than heaviest, 0\.1 kg, got 0\.2"):
        run(settings(lightest=0.2, heaviest=0.1), tmp_path)
