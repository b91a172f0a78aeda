"""Mesh files as users have them: good ones in every format, what is mended, and one line for each way to be wrong."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.objects.config import CollisionConfig
from spgf_torch.objects.mending import mended, open_edges
from spgf_torch.objects.scans import FITTED, Scan, Source, fit, read_body, read_mesh, scan_of
from spgf_torch.paths import root
from spgf_torch.settings import settings

SCANS = root().parent / "shared" / "meshes"
SIZE = (0.06, 0.04, 0.10)


@pytest.fixture(scope="module")
def config() -> CollisionConfig:
    return settings(CollisionConfig, samples=20_000)


def box(scale: float = 1.0) -> trimesh.Trimesh:
    return trimesh.creation.box(np.array(SIZE) * scale)


def loaded(
    path: Path, mesh: trimesh.Trimesh, config: CollisionConfig, category: str = "boxes", unit: str = "m"
) -> Scan:
    mesh.export(path)
    return scan_of(read_body(Source("thing", path, category), unit, 0.095, config), config)


def test_mass_and_inertia_follow_from_the_class(tmp_path: Path, config: CollisionConfig) -> None:
    """240 cm3: a box at 400 kg/m3 is 96 g, a wall at 1500 is 360 g. About z: m (a^2 + b^2) / 12."""
    scan = loaded(tmp_path / "box.ply", box(), config)
    assert scan.object.mass == pytest.approx(0.096)
    assert scan.object.inertia[2, 2] == pytest.approx(0.096 * (0.06**2 + 0.04**2) / 12)
    assert np.allclose(scan.object.com, 0.0, atol=1e-9)
    assert len(scan.object.parts) == scan.check.pieces == 1
    assert scan.check.volume_ratio == pytest.approx(1.0, abs=0.03)
    assert loaded(tmp_path / "box.ply", box(), config, "containers").object.mass == pytest.approx(0.36)
    brick = Source("brick", tmp_path / "box.ply", "boxes", 0.5)
    assert scan_of(read_body(brick, "m", 0.095, config), config).object.mass == 0.5


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "off", "glb"])
def test_formats_give_the_same_closed_mesh(tmp_path: Path, config: CollisionConfig, suffix: str) -> None:
    """STL repeats every vertex for each face: 36 in the file, 8 once merged."""
    path = tmp_path / f"box.{suffix}"
    box().export(path)
    mesh = read_mesh(path, "m", config)
    assert len(mesh.vertices) == 8 and mesh.is_watertight
    assert mesh.volume == pytest.approx(0.06 * 0.04 * 0.10, rel=1e-6)


def test_vertices_are_merged_across_texture_seams(tmp_path: Path, config: CollisionConfig) -> None:
    """An OBJ whose faces have texture coordinates of their own, and a material file that is not there."""
    lines = ["mtllib lost.mtl", *(f"v {x} {y} {z}" for x, y, z in box().vertices)]
    lines += [f"vt {i / 40:.3f} {i % 7 / 7:.3f}" for i in range(36)] + ["usemtl skin"]
    for i, (a, b, c) in enumerate(box().faces + 1):
        lines.append(f"f {a}/{3 * i + 1} {b}/{3 * i + 2} {c}/{3 * i + 3}")
    (tmp_path / "textured.obj").write_text("\n".join(lines))
    mesh = read_mesh(tmp_path / "textured.obj", "m", config)
    assert len(mesh.vertices) == 8 and mesh.is_watertight


@pytest.mark.parametrize(("unit", "scale"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
def test_the_unit_scales_to_metres(tmp_path: Path, config: CollisionConfig, unit: str, scale: float) -> None:
    box(scale).export(tmp_path / "box.ply")
    assert np.allclose(read_mesh(tmp_path / "box.ply", unit, config).extents, SIZE, rtol=1e-6)


def test_a_mesh_without_a_unit_is_scaled_to_the_hand(tmp_path: Path, config: CollisionConfig) -> None:
    """EGAD's rule: 6 x 4 x 10 becomes 57 x 38 x 95 mm for 95 mm; a cube's sides would be 95 > 76 mm, so they are 76.

    The least box around a turned one is meant, not the box along the axes.
    """
    assert np.allclose(
        loaded(tmp_path / "a.obj", box(100), config, unit=FITTED).object.mesh.extents, (0.057, 0.038, 0.095)
    )
    cube = trimesh.creation.box((2.0, 2.0, 2.0))
    cube.apply_transform(trimesh.transformations.rotation_matrix(0.6, (1, 2, 3)))
    assert fit(cube.vertices, 0.095) == pytest.approx(0.095 * 0.8 / 2.0)


def test_the_frame_is_the_mesh_frame(tmp_path: Path, config: CollisionConfig) -> None:
    scan = loaded(tmp_path / "far.ply", box().apply_translation((0.3, -0.2, 0.5)), config)
    assert np.allclose(scan.object.com, (0.3, -0.2, 0.5), atol=1e-6)
    low, high = scan.object.parts[0].min(axis=0), scan.object.parts[0].max(axis=0)
    assert np.allclose((low + high) / 2, (0.3, -0.2, 0.5), atol=1e-3)


def changed(faces: np.ndarray, extra: tuple[float, ...] | None = None) -> trimesh.Trimesh:
    vertices = np.array(box().vertices)
    return trimesh.Trimesh(vertices if extra is None else np.vstack([vertices, extra]), faces, process=False)


FACES = np.array(box().faces)
OPEN = changed(FACES[1:])
FINNED = changed(np.vstack([FACES, [FACES[0][0], FACES[0][1], 8]]), (0.2, 0.2, 0.2))
INVERTED = changed(FACES[:, ::-1])
MIXED = changed(np.vstack([FACES[0][::-1], FACES[1:]]))
TWO_MIXED = trimesh.util.concatenate([MIXED, box().apply_translation((0.2, 0, 0))])
TWICE = changed(np.vstack([FACES, FACES[3]]))
SHEET = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2], [2, 1, 0]], process=False)
TWO_SIDED = changed(np.vstack([FACES, [[0, 1, 8], [8, 1, 0]]]), (0.2, 0.2, 0.2))


def pricked(*triangles: int) -> trimesh.Trimesh:
    """A ball of 30 mm radius with triangles of 5 mm side, some of them missing."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    return trimesh.Trimesh(ball.vertices, np.delete(ball.faces, triangles, axis=0), process=False)


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        (box(), []),
        (INVERTED, ["12 of 12 faces turned outwards"]),
        (MIXED, ["1 of 12 faces turned outwards"]),
        (changed(np.vstack([FACES[0], FACES[1:, ::-1]])), ["11 of 12 faces turned outwards"]),
        (TWICE, ["1 doubled faces left out"]),
        (TWO_SIDED, ["2 doubled faces left out"]),
    ],
)
def test_what_has_one_right_answer_is_mended(mesh: trimesh.Trimesh, words: list[str]) -> None:
    whole, told = mended(mesh, 0.005)
    assert told == words
    assert open_edges(whole) == (0, 0) and whole.is_winding_consistent
    assert whole.volume == pytest.approx(0.06 * 0.04 * 0.10)


def test_pinholes_are_closed_and_wide_holes_left() -> None:
    """Triangles 0 and 500 are far apart: two holes of 5 mm. A middle of the rim lies within 0.2 mm of the ball."""
    whole, told = mended(pricked(0, 500), 0.006)
    assert told == ["2 holes of up to 6 mm closed"] and open_edges(whole) == (0, 0)
    assert whole.volume == pytest.approx(pricked().volume, rel=1e-3)
    assert mended(pricked(0, 500), 0.002)[1] == []
    assert open_edges(mended(pricked(0, 500), 0.002)[0]) == (6, 0)


def test_a_mended_mesh_says_so_and_is_refused_where_nothing_is_mended(tmp_path: Path, config: CollisionConfig) -> None:
    INVERTED.export(tmp_path / "cup.ply")
    body = read_body(Source("cup", tmp_path / "cup.ply", "boxes"), "m", 0.095, config)
    assert body.mended == "12 of 12 faces turned outwards"
    with pytest.raises(InputError, match=r"cup.ply: expected normals .* got an inverted mesh \(volume -240 cm3\)"):
        read_mesh(tmp_path / "cup.ply", "m", config)


def nan_box() -> trimesh.Trimesh:
    mesh = box()
    vertices = np.array(mesh.vertices)
    vertices[3, 1] = np.nan
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (OPEN, "expected a closed surface, .* got 3 open edges and 0 edges with more"),
        (FINNED, "expected a closed surface, .* got 2 open edges and 1 edges with more"),
        (TWO_MIXED, "expected all faces to turn the same way round"),
        (SHEET, "expected a body, got a sheet 0 mm thick on average"),
        (trimesh.creation.box((0.1, 0.1, 1e-6)), "expected a body, got a sheet 0.001 mm thick on average"),
        (nan_box(), "expected finite vertices, got 1 of 8 with NaN or infinity"),
        (box(1000), "expected an extent of 0.005 to 1 m, got 100 m with unit=m; unit=cm or unit=mm would fit"),
        (box(0.001), "expected an extent of 0.005 to 1 m, got 0.0001 m with unit=m"),
    ],
)
def test_a_bad_mesh_is_refused(tmp_path: Path, config: CollisionConfig, mesh: trimesh.Trimesh, message: str) -> None:
    with pytest.raises(InputError, match=r"cup\.ply: " + message) as error:
        loaded(tmp_path / "cup.ply", mesh, config)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("suffix", "content", "message"),
    [
        ("ply", b"", "got an empty file"),
        ("stl", b"\x00" * 10, "got a damaged file|no face"),
        ("obj", b"v 0 0 0\nv 1 0 0\n", "no face|damaged"),
        ("off", b"OFF\n0 0 0\n", "no face|damaged"),
        ("glb", b"glTF", "got a damaged file"),
        ("ply", b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n", "got a part of one"),
    ],
)
def test_files_without_a_mesh_are_refused(
    tmp_path: Path, config: CollisionConfig, suffix: str, content: bytes, message: str
) -> None:
    path = tmp_path / f"cup.{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"cup\.{suffix}: expected .*({message})"):
        read_mesh(path, "m", config)


def test_a_mesh_in_millimetres_read_as_metres_too_small(tmp_path: Path, config: CollisionConfig) -> None:
    box().export(tmp_path / "cup.ply")
    with pytest.raises(InputError, match=r"got 0\.0001 m with unit=mm; unit=m would fit"):
        read_mesh(tmp_path / "cup.ply", "mm", config)


@pytest.mark.skipif(not SCANS.is_dir(), reason="the scans are not part of the repository")
def test_a_scanned_bowl_with_a_wall_of_one_millimetre_keeps_volume_and_cavity() -> None:
    source = Source("bowl", SCANS / "ycb_024_bowl.ply", "containers")
    body = read_body(source, "m", 0.095, settings(CollisionConfig))
    scan = scan_of(body, settings(CollisionConfig))
    assert abs(scan.check.volume_ratio - 1.0) <= 0.15
    assert scan.check.free_space_kept >= 0.95
    assert scan.check.pieces <= 500 and body.mended == ""
