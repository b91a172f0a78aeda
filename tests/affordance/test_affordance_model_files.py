"""Models in files: what comes back is what was saved, and what is damaged or foreign is refused."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from spgf_torch.affordance import model as affordance
from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.pairs import cell_pairs, grid_of
from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.geometry import se3
from spgf_torch.hands.config import HandConfig
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import plain, settings


@pytest.fixture
def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


ROOMS = {"sensing": SensingConfig, "features": FeatureConfig, "prototypes": PrototypeConfig, "hand": HandConfig}


@pytest.fixture
def model(generator: torch.Generator) -> affordance.GraspModel:
    config = settings(AffordanceConfig, reach=0.03, rotation_deg=60, min_support=1, features_per_object=20)
    features, grasps = (se3.random_poses(50, generator) for _ in range(2))
    for T in (features, grasps):
        T[:, :3, 3] *= 0.01
    grasp_type = torch.arange(50) % 2
    pairs = cell_pairs(features, grasps, grasp_type, config, generator)
    assert pairs.feature.unique().numel() == 20
    ids = torch.randint(4, (50,), generator=generator)
    learned = affordance.learn([(pairs, ids, torch.rand(50, generator=generator) < 0.5)], torch.rand(4, 144), config, 2)
    rooms = {name: plain(settings(kind)) for name, kind in ROOMS.items()}
    return replace(learned, settings={**rooms, "affordance": plain(config)})


def test_model_round_trip(model: affordance.GraspModel, tmp_path) -> None:
    affordance.save_model(model, tmp_path)
    back = affordance.load_model(tmp_path)
    assert back.grid == model.grid and torch.equal(back.centres, model.centres)
    assert torch.equal(back.calibration.numbers, model.calibration.numbers)
    for name in ("partition_start", "cell", "probability", "support", "base_rate"):
        assert torch.equal(getattr(back.condensed, name), getattr(model.condensed, name))


@pytest.mark.parametrize(
    ("file", "content", "says"),
    [
        ("model.json", None, "found no such file"),
        ("model.json", "not json", "expected a model's JSON"),
        ("model.json", '{"format": "other"}', "expected format 'spgf_torch model'"),
        ("model.json", "[]", "expected format"),
        ("model.json", '{"format": "spgf_torch model", "schema": 4, "lattice": {}}', "expected lattice with the keys"),
        ("model.safetensors", None, "found no such file"),
        ("model.safetensors", "cut", "expected a safetensors file"),
    ],
)
def test_foreign_models_are_refused(model, tmp_path, file: str, content: str | None, says: str) -> None:
    affordance.save_model(model, tmp_path)
    (tmp_path / file).unlink()
    if content is not None:
        (tmp_path / file).write_text(content)
    with pytest.raises(InputError, match=says) as error:
        affordance.load_model(tmp_path)
    assert "\n" not in str(error.value) and file in str(error.value)


def test_tensors_that_do_not_belong_together_are_refused(model, tmp_path) -> None:
    shorter = replace(model, condensed=replace(model.condensed, cell=model.condensed.cell[:1]))
    affordance.save_model(shorter, tmp_path)
    with pytest.raises(InputError, match="expected cell of shape"):
        affordance.load_model(tmp_path)


def test_cells_out_of_order_are_refused(model, tmp_path) -> None:
    shuffled = replace(model, condensed=replace(model.condensed, cell=model.condensed.cell.flip(0)))
    affordance.save_model(shuffled, tmp_path)
    with pytest.raises(InputError, match="expected cells to rise within a partition"):
        affordance.load_model(tmp_path)


def test_a_model_cut_in_half_is_refused(model, tmp_path) -> None:
    affordance.save_model(model, tmp_path)
    path = tmp_path / "model.safetensors"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputError, match=r"model\.safetensors"):
        affordance.load_model(tmp_path)


def test_a_lattice_too_fine_for_memory_is_refused() -> None:
    with pytest.raises(InputError, match=r"affordance: expected reach, voxel and rotation_deg .* got [\d,]+$"):
        grid_of(settings(AffordanceConfig, voxel=0.002))


def refusal(model: affordance.GraspModel, folder: Path) -> str:
    """What `load_model` says of a model that was saved like this; empty if it takes it."""
    affordance.save_model(model, folder)
    try:
        affordance.load_model(folder)
    except InputError as error:
        return str(error)
    return ""


def test_points_that_would_not_be_found_are_refused(model: affordance.GraspModel, tmp_path: Path) -> None:
    """Each change alone, and what stands just beside it and is well."""
    condensed, cells = model.condensed, model.grid.cells
    start, cell = condensed.partition_start, condensed.cell
    assert len(start) == 9 and start[1] > 2 and start[3] < start[4]

    def changed(name: str, index: int, value: float) -> affordance.GraspModel:
        tensor = getattr(condensed, name).clone()
        tensor[index] = value
        return replace(model, condensed=replace(condensed, **{name: tensor}))

    for bad, words in (
        (changed("partition_start", 0, 1), "expected slice_start to rise from 0"),
        (changed("partition_start", 3, int(start[4]) + 1), "expected slice_start to rise from 0"),
        (changed("cell", -1, cells), f"expected cells below {cells}, got {cells}"),
        (changed("cell", 1, int(cell[0])), "expected cells to rise within a partition"),
        (changed("cell", 0, -1), "expected cell finite and from 0 to inf"),
        (changed("probability", 5, 1.001), "expected probability finite and from 0 to 1"),
        (changed("probability", 5, math.nan), "expected probability finite and from 0 to 1"),
        (changed("support", 5, -0.001), "expected support finite and from 0 to inf"),
        (changed("support", 5, math.inf), "expected support finite and from 0 to inf"),
        (changed("base_rate", 1, -0.001), "expected base_rate finite and from 0 to 1"),
    ):
        assert words in refusal(bad, tmp_path)
    for well in (
        changed("cell", -1, cells - 1),
        changed("cell", 1, int(cell[0]) + 1),  # next to each other
        changed("probability", 5, 1.0),
        changed("support", 5, 0.0),
        changed("base_rate", 1, 1.0),
    ):
        assert refusal(well, tmp_path) == ""
    without = {name: getattr(condensed, name)[start[1] :] for name in ("cell", "probability", "support")}
    nothing_of_the_first = replace(condensed, partition_start=(start - start[1]).clamp(min=0), **without)
    assert refusal(replace(model, condensed=nothing_of_the_first), tmp_path) == ""


def test_tensors_of_other_shapes_or_types_are_refused(model: affordance.GraspModel, tmp_path: Path) -> None:
    condensed, numbers = model.condensed, model.calibration.numbers
    points, K = len(condensed.cell), len(model.centres)
    for name, tensor, words in (
        ("partition_start", condensed.partition_start[1:], "expected slice_start of shape (9,), got (8,)"),
        ("base_rate", torch.full((3,), 0.5), "expected base_rate of shape (2,), got (3,)"),
        ("support", condensed.support[:-1], f"expected support of shape ({points},), got ({points - 1},)"),
        ("probability", condensed.probability.long(), "expected probability to hold numbers, got torch.int64"),
        ("cell", condensed.cell.float(), "expected cell to hold whole numbers, got torch.float32"),
    ):
        other = replace(model, condensed=replace(condensed, **{name: tensor}))
        assert refusal(other, tmp_path).endswith(words)
    narrow = replace(model, centres=torch.rand(K, 143))
    assert refusal(narrow, tmp_path).endswith(f"expected centres of shape (K, 144), got ({K}, 143)")
    flat = replace(model, calibration=replace(model.calibration, numbers=numbers[:, :3]))
    assert refusal(flat, tmp_path).endswith("expected calibration of shape (2, 5), got (2, 3)")


def test_a_lattice_of_other_settings_is_refused(model: affordance.GraspModel, tmp_path: Path) -> None:
    for affordance_settings, refused in (({}, False), ({"voxel": 0.011}, True), ({"voxel": 0.013}, True)):
        said = {**model.settings, "affordance": {**model.settings["affordance"], **affordance_settings}}
        assert ("expected the lattice" in refusal(replace(model, settings=said), tmp_path)) == refused
    without = {name: values for name, values in model.settings.items() if name != "sensing"}
    assert "expected settings with the keys" in refusal(replace(model, settings=without), tmp_path)


def test_a_device_that_is_not_here_is_refused() -> None:
    for name in ("cpu", "cpu:0"):
        affordance.check_device(name)
    for name in ("cpu:1", "meta", "gpu", "cuda:999", ""):
        with pytest.raises(InputError, match=f"expected cpu or an accelerator of this machine, got {name or 'none'}$"):
            affordance.check_device(name)
