"""The shipped set, object by object, and descriptions that cannot be read."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial import ConvexHull

from spgf_torch.errors import InputError
from spgf_torch.objects.library import load_object, load_objects
from spgf_torch.paths import find

SHIPPED = find("data/objects")
GOOD = {
    "name": "cup",
    "category": "containers",
    "mass": 0.1,
    "shape": "round_shell",
    "dimensions": {"profile": [[0.03, 0], [0.04, 0.1]], "wall": 0.002, "base": 0.003},
}


@pytest.fixture(scope="module")
def shipped():
    return load_objects(SHIPPED)


def test_the_set(shipped) -> None:
    assert Counter(item.category for item in shipped) == {"containers": 20, "boxes": 14, "curved": 16}
    assert [item.name for item in shipped] == sorted({item.name for item in shipped})
    assert len({item.digest for item in shipped}) == 50
    assert [item.digest for item in load_objects(SHIPPED)] == [item.digest for item in shipped]


def test_every_surface_is_closed_and_every_piece_convex(shipped) -> None:
    """Exact tilings, handles included: the pieces' volumes add up to the surface's (worst case measured: 2e-11).

    A piece is the hull of its corners; that they are all corners of the hull, or lie on it, is what the sum shows.
    """
    for item in shipped:
        mesh = item.mesh
        assert mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1, item.name
        assert mesh.euler_number == (0 if item.name.startswith(("mug", "cup", "teacup", "pitcher")) else 2), item.name
        assert mesh.volume == pytest.approx(sum(ConvexHull(part).volume for part in item.parts), rel=1e-9), item.name
        assert max(len(part) for part in item.parts) <= 255, item.name
        np.testing.assert_allclose(mesh.bounds[0, 2], 0.0, atol=1e-12)


def test_pieces_do_not_reach_into_the_cavity(shipped) -> None:
    """A ray up the axis meets the floor's two sides only; a point 1 mm above the floor is outside every piece."""
    for item in (item for item in shipped if item.category == "containers"):
        hits, _, _ = item.mesh.ray.intersects_location([[1e-4, 2e-4, -0.01]], [[0.0, 0.0, 1.0]])
        assert len(hits) == 2, item.name
        point = np.array([1e-4, 2e-4, hits[:, 2].max() + 1e-3])
        for part in item.parts:
            equations = ConvexHull(part).equations
            assert (equations[:, :3] @ point + equations[:, 3]).max() > 0, item.name


def test_walls_are_those_of_household_vessels() -> None:
    for file in SHIPPED.glob("*.yaml"):
        values = yaml.safe_load(file.read_text())
        if values["category"] == "containers":
            assert 0.0015 <= values["dimensions"]["wall"] <= 0.006, file.name
        assert file.stem == values["name"]
        assert file.read_text().startswith("# "), f"{file.name}: the product it stands for"


def test_masses_can_be_lifted_and_inertia_is_that_of_a_body(shipped) -> None:
    """Friction 0.6 holds about 1.1 kg; principal moments of any body fulfil the triangle inequality."""
    for item in shipped:
        assert 0.01 <= item.mass <= 0.7, item.name
        moments = np.sort(np.linalg.eigvalsh(item.inertia))
        assert moments[0] > 0 and moments[2] < moments[0] + moments[1], item.name


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shape": "torus"}, r"shape: expected one of round_solid.*; got torus"),
        ({"mass": -1}, r"mass: expected a number from .*, got -1"),
        ({"category": "mugs"}, r"category: expected one of containers, boxes, curved; got mugs"),
        ({"colour": "red"}, r"colour"),
        ({"name": "a/b"}, r"name: expected letters"),
        ({"mass": None}, r"mass"),
        ({"dimensions": 3}, r"dimensions"),
        ({"dimensions": {**GOOD["dimensions"], "wall": 0.05}}, r"wall, base"),
    ],
)
def test_wrong_values_are_named(tmp_path: Path, change: dict, message: str) -> None:
    file = tmp_path / "cup.yaml"
    file.write_text(yaml.safe_dump(GOOD | change))
    with pytest.raises(InputError, match=rf"cup\.yaml: .*{message}") as error:
        load_object(file)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("key", list(GOOD))
def test_missing_keys_are_named(tmp_path: Path, key: str) -> None:
    (tmp_path / "cup.yaml").write_text(yaml.safe_dump({k: v for k, v in GOOD.items() if k != key}))
    with pytest.raises(InputError, match=rf"cup\.yaml: .*{key}"):
        load_objects(tmp_path)


@pytest.mark.parametrize("content", ["", "just text", "a: [1", "- 1\n- 2", "\x00"])
def test_files_that_are_no_description(tmp_path: Path, content: str) -> None:
    (tmp_path / "cup.yaml").write_text(content)
    with pytest.raises(InputError, match=r"cup\.yaml: expected") as error:
        load_objects(tmp_path)
    assert "\n" not in str(error.value)


def test_folders_without_objects(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "absent"):
        with pytest.raises(InputError, match="expected a folder with object descriptions"):
            load_objects(folder)


def test_two_objects_of_one_name(tmp_path: Path) -> None:
    for file in ("a.yaml", "b.yaml"):
        (tmp_path / file).write_text(yaml.safe_dump(GOOD))
    with pytest.raises(InputError, match=r"b\.yaml: name: expected a name of its own, got cup"):
        load_objects(tmp_path)
