"""Collision shapes of a URDF as convex pieces: those it describes, and meshes of every format, scale and shape."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from commands import ROOT
from scipy.spatial import ConvexHull

from spgf_torch.errors import InputError
from spgf_torch.files.mesh_files import mesh_arrays
from spgf_torch.geometry.convex_pieces import open_share
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.robot import Collision, Robot
from spgf_torch.hands.urdf import read_robot

HANDS = ROOT.parent / "shared" / "hands"
# The two jaws of a U, 20 mm apart, on a back 10 mm thick: 60 x 30 x 20 mm. As three boxes, and as one surface.
BOXES = [
    trimesh.creation.box((0.06, 0.01, 0.02)),
    trimesh.creation.box((0.02, 0.03, 0.02)).apply_translation((-0.02, 0.01, 0)),
    trimesh.creation.box((0.02, 0.03, 0.02)).apply_translation((0.02, 0.01, 0)),
]
OUTLINE = np.array([[-30, -5], [30, -5], [30, 25], [10, 25], [10, 5], [-10, 5], [-10, 25], [-30, 25]]) * 1e-3
CAP = np.array([[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4], [0, 5, 6], [0, 6, 7]])
NEXT = np.roll(np.arange(8), -1)
SIDES = [[[i, j, j + 8], [i, j + 8, i + 8]] for i, j in enumerate(NEXT)]
JAW = trimesh.Trimesh(
    np.concatenate([np.column_stack([OUTLINE, np.full(8, z)]) for z in (-0.01, 0.01)]),
    np.concatenate([CAP[:, ::-1], CAP + 8, np.reshape(SIDES, (-1, 3))]),
)


def read(folder: Path, *geometries: str, origin: str = "") -> Robot:
    shapes = "".join(f"<collision>{origin}<geometry>{each}</geometry></collision>" for each in geometries)
    file = folder / "h.urdf"
    file.write_text(f'<robot name="r"><link name="palm">{shapes}</link></robot>')
    return read_robot(HandConfig(name="r", urdf=str(file)))


def refused(folder: Path, geometry: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read(folder, geometry)


def within(pieces: tuple[Collision, ...], points: np.ndarray) -> np.ndarray:
    """(N,) how deep points lie in the deepest of the pieces, m; below 0 outside of all."""
    planes = [ConvexHull(piece.mesh.vertices).equations for piece in pieces]
    return np.max([-(points @ plane[:, :3].T + plane[:, 3]).max(axis=1) for plane in planes], axis=0)


def test_shapes_that_the_urdf_describes(tmp_path: Path) -> None:
    shapes = ('<box size="0.02 0.04 0.06"/>', '<cylinder radius="0.01" length="0.05"/>', '<sphere radius="0.03"/>',
              '<capsule radius="0.01" length="0.05"/>')  # fmt: skip
    robot = read(tmp_path, *shapes, origin='<origin xyz="0.1 0 0" rpy="0 1.5707963267948966 0"/>')
    assert [(piece.link, piece.cut) for piece in robot.collisions] == [("palm", False)] * 4
    extents = [[0.02, 0.04, 0.06], [0.02, 0.02, 0.05], [0.06, 0.06, 0.06], [0.02, 0.02, 0.07]]
    for piece, extent in zip(robot.collisions, extents, strict=True):
        assert np.allclose(piece.mesh.extents, extent, atol=3e-4) and np.allclose(piece.mesh.bounds.sum(axis=0), 0)
        assert piece.mesh.is_volume and piece.mesh.is_convex
        assert np.allclose(piece.T_link_shape @ [0, 0, 1, 1], [1.1, 0, 0, 1])
    assert robot.xml.count("<collision>") == 4
    bare = read(tmp_path)
    assert bare.collisions == () and bare.links == ("palm",)


@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "glb", "off", "dae"])
def test_meshes_of_every_format_in_their_scale(tmp_path: Path, ending: str) -> None:
    if ending == "dae":
        pytest.importorskip("collada")
    trimesh.creation.box((20, 40, 60)).apply_translation((10, 0, 0)).export(tmp_path / f"m.{ending}")
    robot = read(tmp_path, f'<mesh filename="m.{ending}" scale="0.001 0.001 -0.002"/>')
    (piece,) = robot.collisions
    assert piece.cut and piece.mesh.is_volume
    assert np.allclose(piece.mesh.bounds, [[0, -0.02, -0.06], [0.02, 0.02, 0.06]], atol=1e-7)
    assert "collision" not in robot.xml


def test_collada_in_its_own_unit(tmp_path: Path) -> None:
    pytest.importorskip("collada")
    file = tmp_path / "m.dae"
    trimesh.creation.box((20, 40, 60)).export(file)
    told = file.read_text()
    assert "<unit" not in told
    file.write_text(told.replace("</asset>", '<unit name="millimeter" meter="0.001"/></asset>'))
    (piece,) = read(tmp_path, '<mesh filename="m.dae"/>').collisions
    assert np.allclose(piece.mesh.extents, [0.02, 0.04, 0.06])


@pytest.mark.parametrize("kind", ["closed", "open", "inside out", "bodies"])
def test_the_gap_of_a_jaw_stays_free_and_its_faces_stay_where_they_are(tmp_path: Path, kind: str) -> None:
    solid = trimesh.util.concatenate(BOXES) if kind == "bodies" else JAW.copy()
    assert solid.is_volume
    if kind == "open":
        solid.update_faces(solid.face_normals[:, 1] > -0.9)  # no bottom
    if kind == "inside out":
        solid.invert()
    solid.export(tmp_path / "jaw.stl")
    pieces = read(tmp_path, '<mesh filename="jaw.stl"/>').collisions
    assert 2 <= len(pieces) <= 32 and all(len(piece.mesh.faces) <= 255 for piece in pieces)
    x, y = np.meshgrid(np.linspace(-0.008, 0.008, 9), np.linspace(0.0075, 0.024, 9))
    gap = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    assert (within(pieces, gap) < 0.0).all()
    faces = np.array([[side * 0.01, y, z] for side in (-1, 1) for y in (0.01, 0.02) for z in (-0.008, 0.008)])
    depth = within(pieces, faces)
    assert depth.min() > -3e-4 and depth.max() < 1e-3  # neither set back, nor bulging by more than the tolerance


def test_a_screw_hole_in_a_pad_is_filled(tmp_path: Path) -> None:
    plate = trimesh.creation.annulus(r_min=0.0015, r_max=0.012, height=0.008, sections=24)
    plate.export(tmp_path / "plate.stl")
    pieces = read(tmp_path, '<mesh filename="plate.stl"/>').collisions
    assert len(pieces) == 1 and within(pieces, np.zeros((1, 3)))[0] > 0.003


def test_a_hollow_body_is_as_a_solid_one(tmp_path: Path) -> None:
    inside = trimesh.creation.box((0.03, 0.02, 0.01))
    inside.invert()
    trimesh.util.concatenate(trimesh.creation.box((0.034, 0.024, 0.014)), inside).export(tmp_path / "case.stl")
    (piece,) = read(tmp_path, '<mesh filename="case.stl"/>').collisions
    assert np.allclose(piece.mesh.extents, [0.034, 0.024, 0.014])


@pytest.mark.parametrize(("radius", "most"), [(0.012, 1), (0.03, 16)])
def test_a_fine_ball_is_of_pieces_that_physx_takes(tmp_path: Path, radius: float, most: int) -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)  # 2562 corners
    ball.export(tmp_path / "ball.stl")
    pieces = read(tmp_path, '<mesh filename="ball.stl"/>').collisions
    assert len(pieces) <= most and all(len(piece.mesh.faces) <= 255 for piece in pieces)
    depth = within(pieces, ball.triangles_center)
    assert depth.min() > -1.5e-3 and depth.max() < 1e-6 and depth.mean() > -4e-4


def test_shapes_that_cannot_be_are_refused(tmp_path: Path) -> None:
    refused(tmp_path, '<box size="0.02 0 0.06"/>', "link palm: collision: expected a box of some size, got 0.02 0 0.06")
    refused(tmp_path, "<sphere/>", "link palm: collision: sphere radius: expected a finite number, got none")
    refused(tmp_path, "<cone/>", "expected a box, cylinder, sphere, capsule or mesh; got cone")
    refused(tmp_path, "", "link palm: collision: expected a geometry, got none")
    refused(tmp_path, "<mesh/>", "expected the filename of a mesh, got none")
    refused(tmp_path, '<mesh filename="no.stl"/>', "expected the mesh no.stl, got no file")
    (tmp_path / "m.step").write_text("x")
    refused(tmp_path, '<mesh filename="m.step"/>', r"expected a mesh of .stl, .*; got .step")
    trimesh.creation.box((20, 40, 60)).export(tmp_path / "mm.stl")
    refused(tmp_path, '<mesh filename="mm.stl"/>', r'at most 2 m, .*mm.stl has 60 m; scale="0.001 0.001 0.001" if')
    refused(tmp_path, '<mesh filename="mm.stl" scale="0.001 0 1"/>', "expected a scale other than 0, got 0.001 0 1")
    refused(tmp_path, '<mesh filename="mm.stl" scale="0.001"/>', "scale: expected 3 finite numbers, got 0.001")
    (tmp_path / "cut.stl").write_bytes((tmp_path / "mm.stl").read_bytes()[:200])
    refused(tmp_path, '<mesh filename="cut.stl"/>', "cut.stl: expected a mesh with faces, got none")
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    flat.export(tmp_path / "flat.stl")
    refused(tmp_path, '<mesh filename="flat.stl"/>', "flat.stl: expected a mesh with a convex hull")


def test_the_digest_is_of_what_is_in_the_files_not_of_where_they_are(tmp_path: Path) -> None:
    digests = []
    for name, width in (("a", 0.02), ("b", 0.02), ("c", 0.021)):
        (tmp_path / name).mkdir()
        trimesh.creation.box((width, 0.04, 0.06)).export(tmp_path / name / "m.stl")
        digests.append(read(tmp_path / name, '<mesh filename="m.stl"/>').digest)
    assert digests[0] == digests[1] != digests[2]


PUBLIC = {
    "robotiq_2f85_pn": "robotiq_85_base_link",
    "wsg50": "base_link",
    "barrett": "base_link",
}


@pytest.mark.skipif(not HANDS.is_dir(), reason="public hands are not here")
@pytest.mark.parametrize("name", PUBLIC)
def test_public_hands_are_read_as_they_come(name: str) -> None:
    robot = read_robot(HandConfig(name=name, urdf=str(HANDS / name / f"{name}.urdf")))
    assert robot.root == PUBLIC[name]
    pieces = [piece.link for piece in robot.collisions]
    assert max(map(pieces.count, pieces)) <= 32 and all(len(piece.mesh.faces) <= 255 for piece in robot.collisions)


@pytest.mark.skipif(not HANDS.is_dir(), reason="public hands are not here")
def test_the_finger_of_a_public_hand_keeps_its_faces_and_its_notch() -> None:
    robot = read_robot(HandConfig(name="wsg50", urdf=str(HANDS / "wsg50/wsg50.urdf")))
    pieces = tuple(piece for piece in robot.collisions if piece.link == "finger_left")
    vertices, faces = mesh_arrays(HANDS / "packages/wsg_50_simulation/meshes/WSG-FMF.stl")
    mesh = trimesh.Trimesh(vertices * 1e-3, faces)
    points, face = trimesh.sample.sample_surface(mesh, 4000, seed=1)
    normals = mesh.face_normals[face]
    share = open_share(mesh, points, normals)
    assert within(pieces, points[share > 0.25]).min() > -3.4e-4
    before = points[share > 0.9] + 0.003 * normals[share > 0.9]  # 3 mm before faces with nothing near
    assert (within(pieces, before) > 0.0).mean() < 0.002
    hull = trimesh.Trimesh(vertices * 1e-3).convex_hull
    assert hull.volume > 1.7 * mesh.volume  # what a simulator that takes the hull would fill
