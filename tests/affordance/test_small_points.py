"""Models made small: what is left out and rounded, what is read again, and files made to hurt."""

import json
import zlib
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save
from torch import Tensor

from spgf_torch.affordance.calibration import uncalibrated
from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import GraspModel, grid_of, load_model, save_model
from spgf_torch.affordance.neighbourhood import Condensed
from spgf_torch.affordance.small_config import SmallConfig
from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.files.digests import BLANK, KEY, digest_of, sealed, sealed_json
from spgf_torch.hands.config import HandConfig
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import plain, settings

# Levels of probability 0, 1/9, 4/9, 1; of support 4, 8, 16.
HOW = settings(SmallConfig, points=6, probabilities=4, supports=3, most=16.0)


@pytest.fixture
def model() -> GraspModel:
    """Two prototypes, two types: points in the partitions 0 (four), 2 (three) and 3 (one); none in 1."""
    rooms = {"sensing": SensingConfig, "features": FeatureConfig, "prototypes": PrototypeConfig, "hand": HandConfig}
    said = {name: plain(settings(kind)) for name, kind in (rooms | {"affordance": AffordanceConfig}).items()}
    condensed = Condensed(
        torch.tensor([0, 4, 4, 7, 8]),
        torch.tensor([0, 1, 256, 600, 5, 300, 90_000, 7]).int(),
        torch.tensor([0.0, 0.1, 0.2, 1.0, 0.5, 0.0, 0.03, 0.9]),
        torch.tensor([4.0, 3.9, 5.0, 700.0, 7.0, 12.0, 2.0, 16.0]),
        torch.tensor([0.1, 0.4]),
    )
    lattice = grid_of(settings(AffordanceConfig))
    return GraspModel(torch.zeros(2, 144), condensed, lattice, uncalibrated(condensed.base_rate), said)


def test_what_stays_and_what_is_rounded(model: GraspModel, tmp_path: Path) -> None:
    """By hand: the points of support 3.9 and 2 go; sqrt(0.2) = 0.45 is nearest to 1/3, sqrt(0.5) = 0.71 to 2/3."""
    save_model(model, tmp_path, HOW)
    back = load_model(tmp_path)
    assert back.condensed.partition_start.tolist() == [0, 3, 3, 5, 6]
    assert back.condensed.cell.tolist() == [0, 256, 600, 5, 300, 7] and back.condensed.cell.dtype == torch.int32
    assert back.condensed.probability.tolist() == pytest.approx([0, 1 / 9, 1, 4 / 9, 0, 1])
    assert back.condensed.support.tolist() == pytest.approx([4, 4, 16, 8, 16, 16])
    assert torch.equal(back.condensed.base_rate, model.condensed.base_rate)
    assert back.about["small"] == {"of": None, "points": 6, "left_out": 2}


def test_a_small_one_of_a_file_says_which(model: GraspModel, tmp_path: Path) -> None:
    """Also when it is made small again; the date of learning stays."""
    for name in ("whole", "small", "smaller"):
        (tmp_path / name).mkdir()
    save_model(replace(model, about={"date": "2020-02-03"}), tmp_path / "whole")
    save_model(load_model(tmp_path / "whole"), tmp_path / "small", HOW)
    save_model(load_model(tmp_path / "small"), tmp_path / "smaller", replace(HOW, points=4))
    about = load_model(tmp_path / "smaller").about
    assert about["small"] == {"of": digest_of(tmp_path / "whole/model.safetensors"), "points": 4, "left_out": 4}
    assert about["date"] == "2020-02-03" and about["tensors_sha256"] != about["small"]["of"]


def test_settings_that_cannot_be(model: GraspModel, tmp_path: Path) -> None:
    nothing = {name: getattr(model.condensed, name)[:0] for name in ("cell", "probability", "support")}
    empty = replace(model, condensed=replace(model.condensed, partition_start=torch.zeros(5).long(), **nothing))
    with pytest.raises(InputError, match=r"^model: expected points to keep, got a model without any$"):
        save_model(empty, tmp_path, HOW)
    with pytest.raises(InputError, match=r"^small\.supports: expected 256 levels at most with probabilities, got 4096"):
        save_model(model, tmp_path, replace(HOW, probabilities=64, supports=64))
    assert not list(tmp_path.iterdir())


def deflated(*values: int) -> Tensor:
    return torch.frombuffer(bytearray(zlib.compress(bytes(values))), dtype=torch.uint8)


def refusal(folder: Path, **changed: Tensor) -> str:
    """What is said of the small model in the folder with other tensors, sealed as they should be; empty if nothing."""
    tensors = {**load_file(folder / "model.safetensors"), **changed}
    (folder / "model.safetensors").write_bytes(sealed(save(tensors, {KEY: BLANK.decode()})))
    document = json.loads((folder / "model.json").read_text())
    document.pop(KEY)
    document["tensors_sha256"] = digest_of(folder / "model.safetensors")
    (folder / "model.json").write_bytes(sealed_json(document))
    try:
        load_model(folder)
    except InputError as error:
        return str(error)
    return ""


def leaps(*values: int) -> Tensor:
    return deflated(*b"".join(value.to_bytes(4, "little", signed=True) for value in values))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"cell_steps": deflated(0, 255, 255, 5, 255)}, "cell_steps"),  # too few
        ({"cell_steps": deflated(0, 255, 255, 5, 255, 7, 0)}, "cell_steps"),  # too many
        ({"cell_steps": torch.zeros(40, dtype=torch.uint8)}, "cell_steps"),  # not deflated
        ({"cell_steps": deflated(*[0] * 3_000_000)}, "cell_steps"),  # grows
        ({"cell_steps": deflated(0, 255, 255, 5, 255, 7).float()}, "cell_steps"),
        ({"cell_leaps": leaps(255, 343)}, "cell_leaps"),
        ({"cell_leaps": leaps(255, 343, 254)}, "cell_leaps"),
        ({"cell_leaps": leaps(255, 343, -1)}, "cell_leaps"),
        ({"cell_leaps": leaps(255, 343, 2**31 - 1)}, "cell_leaps"),
        ({"cell_leaps": leaps(16_383_000, 16_383_000, 294)}, "cells below"),
        ({"levels": deflated(0, 1, 2, 3, 4, 12)}, "level_probability"),
        ({"level_probability": torch.zeros(0)}, "level_probability"),
        ({"level_probability": torch.full((12,), 1.5)}, "probability finite and from 0 to 1"),
        ({"level_support": torch.full((12,), torch.nan)}, "support finite"),
        ({"level_support": torch.zeros(12, dtype=torch.float64)}, "level_support"),
        ({"slice_start": torch.tensor([0, 3, 3, 5, 10**15])}, "points at most"),
        ({"slice_start": torch.tensor([0, 5, 3, 5, 6])}, "slice_start"),
        ({"slice_start": torch.tensor([0, 3, 3, 5, -6])}, "slice_start"),
        ({"slice_start": torch.tensor(6)}, "slice_start"),
        ({"slice_start": torch.tensor([0, 6])}, "slice_start of shape"),
        ({"base_rate": torch.zeros(3)}, "base_rate of shape"),
    ],
)
def test_what_is_not_written_so_is_refused(
    model: GraspModel, tmp_path: Path, changed: dict[str, Tensor], words: str
) -> None:
    save_model(model, tmp_path, HOW)
    assert refusal(tmp_path) == ""
    said = refusal(tmp_path, **changed)
    assert "model.safetensors: expected" in said and words in said and "\n" not in said


def test_a_small_model_without_a_tensor(model: GraspModel, tmp_path: Path) -> None:
    save_model(model, tmp_path)
    document = json.loads((tmp_path / "model.json").read_text())
    document.pop(KEY)
    for small, words in (
        ({"points": 8, "left_out": 0}, "missing cell_steps"),
        ({"points": "8"}, "whole numbers points"),
    ):
        (tmp_path / "model.json").write_bytes(sealed_json({**document, "small": small}))
        with pytest.raises(InputError, match=words):
            load_model(tmp_path)
