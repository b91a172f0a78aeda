"""`grasps.glb`, read back by two readers: frames, names, colours, sizes."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from asymmetric import GRIPPERS, asymmetric, exact_pose

from spgf_torch.errors import InputError
from spgf_torch.formats.glb import Surroundings, write_glb
from spgf_torch.grasps.grasps import Grasps, Source
from spgf_torch.scene.scene import Scene
from spgf_torch.sensing.texlets import Texlets

# Two texlets 10 mm apart, one facing up and one +x, an obstacle, a table 50 mm below the origin.
POSITIONS, NORMALS = np.array([[0.1, 0.2, 0.3], [0.11, 0.2, 0.3]]), np.array([[0.0, 0, 1], [1.0, 0, 0]])
OBSTACLES, TABLE = np.array([[0.4, -0.1, 0.02]]), np.array([0.0, 0, 2, 0.1])
BESIDE = Surroundings(POSITIONS, NORMALS, 0.005, OBSTACLES, TABLE)
GRASPS = [asymmetric("WPG", 1.0), asymmetric("NPG", 0.0), replace(asymmetric("NPG", 0.5), score=-0.25)]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("glb") / "grasps.glb"
    write_glb(place, GRASPS, GRIPPERS, BESIDE)
    return place


def points_of(scene: trimesh.Scene, name: str) -> np.ndarray:
    """(N, 3) of a node in glTF's frame."""
    T, geometry = scene.graph[name]
    return trimesh.transform_points(scene.geometry[geometry].vertices, T)


def in_gltf(points: np.ndarray) -> np.ndarray:
    """(x, y, z) of the input is (x, z, -y) of glTF."""
    return np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)


def test_everything_is_where_it_was_with_z_as_gltf_s_y(path: Path) -> None:
    scene = trimesh.load_scene(path)
    names = {"cloud", "obstacles", "table", "rank_1_WPG", "rank_2_NPG", "rank_3_NPG"}
    assert set(scene.graph.nodes_geometry) == set(scene.geometry) == names
    for name in ("rank_1_WPG", "rank_3_NPG"):
        corners = np.concatenate([shape.vertices for shape in GRIPPERS[name[-3:]].shapes])
        expected = in_gltf(trimesh.transform_points(corners, exact_pose()))
        np.testing.assert_allclose(points_of(scene, name), expected, atol=1e-6)
        assert scene.geometry[scene.graph[name][1]].is_watertight
    np.testing.assert_allclose(points_of(scene, "obstacles"), [[0.4, 0.02, 0.1]], atol=1e-6)


def test_texlets_are_squares_that_face_their_side(path: Path) -> None:
    """5 mm wide about their places; normals z and x of the input are y and x of glTF."""
    scene = trimesh.load_scene(path)
    corners = points_of(scene, "cloud").reshape(2, 4, 3)
    np.testing.assert_allclose(corners.mean(1), in_gltf(POSITIONS), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(np.diff(corners, axis=1), axis=2), 0.005, atol=1e-6)
    cloud = scene.geometry["cloud"].copy()
    cloud.apply_transform(scene.graph["cloud"][0])
    np.testing.assert_allclose(cloud.face_normals, [[0, 1, 0], [0, 1, 0], [1, 0, 0], [1, 0, 0]], atol=1e-3)


def test_the_table_lies_below_with_a_border(path: Path) -> None:
    """Of 2 z + 0.1, which is not of length 1: 50 mm below, from 80 mm beside what is outermost."""
    low, high = (
        f(0)
        for f in (points_of(trimesh.load_scene(path), "table").min, points_of(trimesh.load_scene(path), "table").max)
    )
    np.testing.assert_allclose(low, [0.1 - 0.08, -0.05, -0.2 - 0.08], atol=1e-6)
    np.testing.assert_allclose(high, [0.4 + 0.08, -0.05, 0.1 + 0.08], atol=1e-6)


def header(path: Path) -> dict:
    """The JSON of a GLB, by its specification (section 4.4): magic, version, length; length, type, chunk."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    return json.loads(data[20 : 20 + size])


def test_nodes_say_what_they_are(path: Path) -> None:
    """The root turns z to y (columns, one after another); names, extras and colours as other programs find them."""
    found = header(path)
    nodes = {node["name"]: node for node in found["nodes"]}
    assert nodes["input"]["matrix"] == [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]
    assert len(nodes["input"]["children"]) == 6 and [
        found["nodes"][i]["name"] for i in found["scenes"][0]["nodes"]
    ] == ["input"]
    assert nodes["rank_3_NPG"]["extras"] == {
        "rank": 3,
        "type": "NPG",
        "probability": 0.5,
        "score": -0.25,
        "support": 42,
    }
    of_mesh = {mesh["name"]: found["materials"][mesh["primitives"][0]["material"]] for mesh in found["meshes"]}
    green, red = (of_mesh[name]["pbrMetallicRoughness"] for name in ("rank_1_WPG", "rank_2_NPG"))
    # "#0f6b37" and "#c8102e": 0x6b is 0.4196 of sRGB, ((0.4196 + 0.055) / 1.055)^2.4 = 0.1470; 0xc8 is 0.7843: 0.5776.
    assert green["baseColorFactor"][1] == pytest.approx(0.1470, abs=3e-3) and green["metallicFactor"] == 0
    assert red["baseColorFactor"][0] == pytest.approx(0.5776, abs=3e-3)


def test_another_reader_finds_the_same(path: Path) -> None:
    """pygltflib: poses of the hands in the root's frame, and shapes that are in the file once a type."""
    pygltflib = pytest.importorskip("pygltflib")
    read = pygltflib.GLTF2().load(str(path))
    hands = [node for node in read.nodes if node.name.startswith("rank_")]
    assert [node.name for node in hands] == ["rank_1_WPG", "rank_2_NPG", "rank_3_NPG"]
    np.testing.assert_allclose(np.array(hands[0].matrix).reshape(4, 4).T, exact_pose(), atol=1e-6)
    two, three = (read.meshes[node.mesh].primitives[0] for node in hands[1:])
    assert two.attributes.POSITION == three.attributes.POSITION and two.material != three.material
    view = read.bufferViews[read.accessors[two.attributes.POSITION].bufferView]
    corners = np.frombuffer(read.binary_blob(), "<f4", 3 * 16, view.byteOffset).reshape(16, 3)
    np.testing.assert_allclose(corners, np.concatenate([s.vertices for s in GRIPPERS["NPG"].shapes]), atol=1e-7)


def test_a_coloured_cloud_keeps_its_colours(tmp_path: Path) -> None:
    """As linear bytes: 188 of sRGB is 0.7373, half the light: 0.5029, 128 of 255."""
    colours = np.array([[188, 0, 255], [0, 188, 0]], dtype=np.uint8)
    write_glb(tmp_path / "a.glb", [], GRIPPERS, replace(BESIDE, colours=colours))
    found = trimesh.load_scene(tmp_path / "a.glb").geometry["cloud"].visual
    read = (
        found.vertex_attributes["color"] if "color" in getattr(found, "vertex_attributes", {}) else found.vertex_colors
    )
    assert read.reshape(2, 4, 4)[:, 0].tolist() == [[128, 0, 255, 255], [0, 128, 0, 255]]


def test_surroundings_move(tmp_path: Path) -> None:
    """A quarter turn about x: up becomes -y, and 1 m along z."""
    T = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 1], [0, 0, 0, 1]])
    moved = BESIDE.transform(T)
    np.testing.assert_allclose(moved.positions[0], [0.1, -0.3, 1.2])
    np.testing.assert_allclose(moved.normals, [[0, -1, 0], [1, 0, 0]])
    np.testing.assert_allclose(moved.obstacles[0], [0.4, -0.02, 0.9])
    assert moved.table is not None
    on_table = T @ [0.7, 0.3, -0.05, 1]
    assert moved.table @ on_table == pytest.approx(0) and moved.table[:3] == pytest.approx([0, -2, 0])


def test_saved_grasps_and_their_cloud_move_together(path: Path, tmp_path: Path) -> None:
    """By `Grasps.save`: moved 1 m along x, all is (x + 1, z, -y); grasps without their scene are hands alone."""
    texlets = Texlets(*(torch.from_numpy(part).float() for part in (POSITIONS, NORMALS)))
    seen = Scene(texlets, torch.ones(2), torch.from_numpy(OBSTACLES).float(), TABLE, None, None, 0.005, ())
    source = Source(None, seen, np.eye(4))  # type: ignore[arg-type]
    grasps, T = Grasps(tuple(GRASPS), GRIPPERS, source=source), np.eye(4)
    T[0, 3] = 1.0
    assert grasps.transform(T).save(tmp_path, "glb") == [tmp_path / "grasps.glb"]
    scene = trimesh.load_scene(tmp_path / "grasps.glb")
    first = trimesh.load_scene(path)
    for name in ("cloud", "obstacles", "table", "rank_1_WPG"):
        np.testing.assert_allclose(points_of(scene, name) - points_of(first, name) - T[:3, 3], 0, atol=1e-6)
    replace(grasps, source=None).save(tmp_path, ["glb"], replace=True)
    assert len(trimesh.load_scene(tmp_path / "grasps.glb").geometry) == 3


def test_nothing_and_what_does_not_fit(tmp_path: Path) -> None:
    none = np.zeros((0, 3))
    write_glb(tmp_path / "empty.glb", [], GRIPPERS, Surroundings(none, none, 0.005, none, TABLE))
    assert [node["name"] for node in header(tmp_path / "empty.glb")["nodes"]] == ["input"]
    write_glb(tmp_path / "hands.glb", GRASPS, GRIPPERS)
    assert len(header(tmp_path / "hands.glb")["meshes"]) == 3
    with pytest.raises(
        InputError,
        match=r"^surroundings: expected positions, normals, colours \(N, 3\) and obstacles .*, got \(2, 3\), \(0, 3\)",
    ):
        replace(BESIDE, normals=none)
    with pytest.raises(InputError, match="grasp type: expected one of NPG"):
        write_glb(tmp_path / "a.glb", GRASPS, {"NPG": GRIPPERS["NPG"]})
    assert not (tmp_path / "a.glb").exists()
