"""Mesh folders as users have them: good ones in every format, and one line for each way to be wrong."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from spgf_torch.config import CLASSES, CollisionConfig, InputError, root, settings
from spgf_torch.objects.scans import CATEGORIES, load_scans, read_mesh

SCANS = root().parent / "shared" / "meshes"
SIZE = (0.06, 0.04, 0.10)


@pytest.fixture(scope="module")
def config() -> CollisionConfig:
    return settings(CollisionConfig, samples=20_000)


def box(scale: float = 1.0) -> trimesh.Trimesh:
    return trimesh.creation.box(np.array(SIZE) * scale)


def folder_of(place: Path, manifest: str | None, **meshes: trimesh.Trimesh) -> Path:
    """A folder with `meshes` as NAME.ply and the manifest's lines under the usual heading."""
    for name, mesh in meshes.items():
        mesh.export(place / f"{name}.ply")
    if manifest is not None:
        (place / "manifest.csv").write_text("name,file,class\n" + manifest)
    return place


def test_the_manifest_says_name_class_and_mass(tmp_path: Path, config: CollisionConfig) -> None:
    """Without a mass: 240 cm3 at 400 kg/m3 is 96 g. The inertia of a box about z: m (a^2 + b^2) / 12."""
    folder_of(tmp_path, None, pack=box(), brick=box())
    lines = ["name,file,class,mass,note", "pack,pack.ply,box,,a carton", "brick,brick.ply,box, 0.5 ,"]
    (tmp_path / "manifest.csv").write_text("\n".join(lines))
    brick, pack = load_scans(tmp_path, "m", config)
    assert (brick.object.name, pack.object.name) == ("brick", "pack")
    assert pack.object.category == "boxes"
    assert brick.object.mass == 0.5
    assert pack.object.mass == pytest.approx(0.096)
    assert brick.object.inertia[2, 2] == pytest.approx(0.5 * (0.06**2 + 0.04**2) / 12)
    assert np.allclose(brick.object.com, 0.0, atol=1e-9)
    assert len(brick.object.parts) == brick.check.pieces == 1
    assert brick.check.volume_ratio == pytest.approx(1.0, abs=0.03)


def test_a_container_weighs_as_a_wall(tmp_path: Path, config: CollisionConfig) -> None:
    """240 cm3 of wall at 1500 kg/m3: 360 g."""
    (scan,) = load_scans(folder_of(tmp_path, "mug,mug.ply,container\n", mug=box()), "m", config)
    assert scan.object.category == "containers" and scan.object.mass == pytest.approx(0.36)


def test_every_class_of_the_manifest_is_a_class_of_the_paper() -> None:
    assert tuple(CATEGORIES.values()) == CLASSES


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "off", "glb"])
def test_formats_give_the_same_closed_mesh(tmp_path: Path, config: CollisionConfig, suffix: str) -> None:
    """STL repeats every vertex for each face: 36 in the file, 8 once merged."""
    path = tmp_path / f"box.{suffix}"
    box().export(path)
    mesh = read_mesh(path, "m", config)
    assert len(mesh.vertices) == 8 and mesh.is_watertight
    assert mesh.volume == pytest.approx(0.06 * 0.04 * 0.10, rel=1e-6)


@pytest.mark.parametrize(("unit", "scale"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
def test_the_unit_scales_to_metres(tmp_path: Path, config: CollisionConfig, unit: str, scale: float) -> None:
    box(scale).export(tmp_path / "box.ply")
    assert np.allclose(read_mesh(tmp_path / "box.ply", unit, config).extents, SIZE, rtol=1e-6)


def test_the_frame_is_the_mesh_frame(tmp_path: Path, config: CollisionConfig) -> None:
    mesh = box().apply_translation((0.3, -0.2, 0.5))
    (scan,) = load_scans(folder_of(tmp_path, "far,far.ply,box\n", far=mesh), "m", config)
    assert np.allclose(scan.object.com, (0.3, -0.2, 0.5), atol=1e-6)
    low, high = scan.object.parts[0].min(axis=0), scan.object.parts[0].max(axis=0)
    assert np.allclose((low + high) / 2, (0.3, -0.2, 0.5), atol=1e-3)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("cup,box.ply,cupboard", r"manifest.csv:2: class: expected one of container, box, curved; got 'cupboard'"),
        ("cup,none.ply,box", r"none.ply: expected the mesh that .*manifest.csv:2 lists, got nothing there"),
        ("a/b,box.ply,box", r"manifest.csv:2: name: expected letters, digits, _ and -, got 'a/b'"),
        ("..,box.ply,box", r"manifest.csv:2: name: expected letters, digits, _ and -, got '..'"),
        ("cup,../box.ply,box", r"manifest.csv:2: file: expected a .* got '../box.ply'"),
        ("cup,box.txt,box", r"manifest.csv:2: file: expected a .ply/.* got 'box.txt'"),
        ("cup,box.ply,box\ncup,box.ply,box", r"manifest.csv:3: expected each name once, got cup again \(line 2\)"),
        ("cup", r"manifest.csv:2: class: expected one of"),
        ("", r"manifest.csv: expected one line a mesh, got none"),
    ],
)
def test_a_wrong_manifest_is_named_with_its_line(
    tmp_path: Path, config: CollisionConfig, line: str, message: str
) -> None:
    refused(folder_of(tmp_path, line, box=box()), "m", config, message)


def test_a_mass_must_be_kilograms(tmp_path: Path, config: CollisionConfig) -> None:
    folder_of(tmp_path, None, box=box())
    for mass in ("heavy", "0", "-1", "nan", "inf"):
        (tmp_path / "manifest.csv").write_text(f"name,file,class,mass\ncup,box.ply,box,{mass}\n")
        refused(tmp_path, "m", config, f"manifest.csv:2: mass: expected kilograms above 0, got '{mass}'")


def test_folders_that_are_none(tmp_path: Path, config: CollisionConfig) -> None:
    refused(tmp_path / "nowhere", "m", config, "nowhere: expected a folder of meshes, got nothing there")
    refused(tmp_path, "m", config, r"expected meshes \(.ply, .obj, .stl, .off, .glb\), got none")
    folder_of(tmp_path, None, box=box())
    refused(tmp_path, "m", config, "manifest.csv: expected a table with the columns name, file, class .* got none")
    refused(tmp_path / "box.ply", "m", config, "box.ply: expected a folder of meshes, got a file")
    (tmp_path / "manifest.csv").write_text("object,path\na,b\n")
    refused(tmp_path, "m", config, "expected the columns name, file, class; got object, path")
    (tmp_path / "manifest.csv").write_bytes(b"name,file,class\n\xff\xfe\x00,x,y\n")
    refused(tmp_path, "m", config, "manifest.csv: expected a table of comma-separated text")
    refused(tmp_path, "inch", config, "unit: expected one of m, cm, mm; got inch")


def open_box() -> trimesh.Trimesh:
    mesh = box()
    return trimesh.Trimesh(mesh.vertices, mesh.faces[1:], process=False)


def finned_box() -> trimesh.Trimesh:
    """A third face at one edge: 1 edge with more than two faces, 2 open ones."""
    mesh = box()
    vertices = np.concatenate([mesh.vertices, [[0.2, 0.2, 0.2]]])
    return trimesh.Trimesh(vertices, [*mesh.faces, [mesh.faces[0][0], mesh.faces[0][1], 8]], process=False)


def inverted_box() -> trimesh.Trimesh:
    mesh = box()
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)


def mixed_box() -> trimesh.Trimesh:
    mesh = box()
    return trimesh.Trimesh(mesh.vertices, [mesh.faces[0][::-1], *mesh.faces[1:]], process=False)


def nan_box() -> trimesh.Trimesh:
    mesh = box()
    vertices = np.array(mesh.vertices)
    vertices[3, 1] = np.nan
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (open_box(), "expected a closed surface, .* got 3 open edges and 0 edges with more"),
        (finned_box(), "expected a closed surface, .* got 2 open edges and 1 edges with more"),
        (inverted_box(), r"expected normals pointing outwards, got an inverted mesh \(volume -240 cm3\)"),
        (mixed_box(), "expected all faces to turn the same way round"),
        (nan_box(), "expected finite vertices, got 1 of 8 with NaN or infinity"),
        (box(1000), "expected an extent of 0.005 to 1 m, got 100 m with unit=m; unit=cm or unit=mm would fit"),
        (box(0.001), "expected an extent of 0.005 to 1 m, got 0.0001 m with unit=m"),
    ],
)
def test_a_bad_mesh_is_refused(tmp_path: Path, config: CollisionConfig, mesh: trimesh.Trimesh, message: str) -> None:
    refused(folder_of(tmp_path, "cup,cup.ply,box\n", cup=mesh), "m", config, r"cup\.ply: " + message)


@pytest.mark.parametrize(
    ("suffix", "content", "message"),
    [
        ("ply", b"", "got a damaged file"),
        ("stl", b"\x00" * 10, "got a damaged file|no face"),
        ("obj", b"v 0 0 0\nv 1 0 0\n", "no face|damaged"),
        ("off", b"OFF\n0 0 0\n", "no face|damaged"),
        ("glb", b"glTF", "got a damaged file"),
        ("ply", b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n", "got a damaged file|no face"),
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
def test_a_scanned_bowl_with_a_wall_of_one_millimetre_keeps_volume_and_cavity(tmp_path: Path) -> None:
    (tmp_path / "bowl.ply").write_bytes((SCANS / "ycb_024_bowl.ply").read_bytes())
    (scan,) = load_scans(folder_of(tmp_path, "bowl,bowl.ply,container\n"), "m", settings(CollisionConfig))
    assert abs(scan.check.volume_ratio - 1.0) <= 0.15
    assert scan.check.free_space_kept >= 0.95
    assert scan.check.pieces <= 500


def refused(folder: Path, unit: str, config: CollisionConfig, message: str) -> None:
    """One line that matches."""
    with pytest.raises(InputError, match=message) as error:
        load_scans(folder, unit, config)
    assert "\n" not in str(error.value)
