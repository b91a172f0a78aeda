"""Every format of point cloud, written by hand or by the stock writers, and read back; what is refused, and how."""

import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.files.mesh_files import mesh_arrays, ply_faces
from spgf_torch.geometry.principal import principal_axes
from spgf_torch.scene.cloud import Cloud, voxel_means
from spgf_torch.scene.files import read_cloud

LIMIT = 1000
POINTS = np.array([[0.1, -0.2, 0.3], [1.5, 0.25, -0.75], [0.0, 0.5, 2.0]])
NORMALS = np.array([[1.0, 0, 0], [0, -0.6, 0.8], [0, 0, 1]])
BOTH = np.hstack([POINTS, NORMALS])


def ply(kind: str, columns: np.ndarray, names: str) -> bytes:
    """A PLY file by hand, with a colour that is to be ignored."""
    head = ["ply", f"format {kind} 1.0", "comment by hand", f"element vertex {len(columns)}"]
    head += [f"property double {name}" for name in names.split()] + ["property uchar red", "end_header", ""]
    rows = np.zeros(
        len(columns), [(name, ">f8" if "big" in kind else "<f8") for name in names.split()] + [("red", "u1")]
    )
    for name, column in zip(names.split(), columns.T, strict=True):
        rows[name] = column
    body = (
        "".join(" ".join(map(str, row)) + "\n" for row in rows.tolist()).encode() if kind == "ascii" else rows.tobytes()
    )
    return "\n".join(head).encode() + body


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    path.write_bytes(ply(kind, BOTH, "x y z nx ny nz"))
    cloud = read_cloud(path, LIMIT)
    np.testing.assert_allclose(cloud.points, POINTS)
    np.testing.assert_allclose(cloud.normals, NORMALS)
    path.write_bytes(ply(kind, POINTS, "x y z"))
    assert read_cloud(path, LIMIT).normals is None
    assert ply_faces(path) == 0


def test_trimesh_writes_what_is_read(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    trimesh.PointCloud(POINTS).export(path)
    np.testing.assert_allclose(read_cloud(path, LIMIT).points, POINTS, atol=1e-6)
    trimesh.creation.box().export(path)
    assert ply_faces(path) == 12


@pytest.mark.parametrize("name", ["a.xyz", "a.csv", "a.txt"])
@pytest.mark.parametrize(
    ("content", "normals"),
    [
        ("0.1 -0.2 0.3\n1.5 0.25 -0.75\n0 0.5 2\n", False),
        ("# by hand\n0.1,-0.2,0.3\n1.5,0.25,-0.75\n0,0.5,2\n", False),
        ("//X;Y;Z\n0.1;-0.2;0.3;1;0;0\n1.5;0.25;-0.75;0;-0.6;0.8\n0;0.5;2;0;0;1", True),
        ("intensity,x,y,z\n7,0.1,-0.2,0.3\n7,1.5,0.25,-0.75\n7,0,0.5,2\n", False),
        ("Normal_X nz ny x y z\n1 0 0 .1 -.2 .3\n0 .8 -.6 1.5 .25 -.75\n0 1 0 0 .5 2\n", True),
    ],
    ids=["blanks", "commas", "semicolons", "named", "named normals"],
)
def test_text(name: str, content: str, normals: bool, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    cloud = read_cloud(tmp_path / name, LIMIT)
    np.testing.assert_allclose(cloud.points, POINTS)
    if normals:
        np.testing.assert_allclose(cloud.normals, NORMALS)
    else:
        assert cloud.normals is None


def test_numpy(tmp_path: Path) -> None:
    np.save(tmp_path / "three.npy", POINTS.astype(np.float32))
    np.testing.assert_allclose(read_cloud(tmp_path / "three.npy", LIMIT).points, POINTS, atol=1e-7)
    np.save(tmp_path / "six.npy", BOTH)
    np.testing.assert_allclose(read_cloud(tmp_path / "six.npy", LIMIT).normals, NORMALS)
    np.savez(tmp_path / "named.npz", points=POINTS, normals=NORMALS, viewpoints=[[0.0, 0, 1]])
    cloud = read_cloud(tmp_path / "named.npz", LIMIT)
    np.testing.assert_allclose(cloud.normals, NORMALS)
    np.testing.assert_allclose(cloud.viewpoints, [[0, 0, 1]])


def test_pixels_without_a_measurement_are_dropped(tmp_path: Path) -> None:
    """NaN, infinity and the zeros that RealSense writes, in an image of points and in a list of them."""
    image = np.concatenate([POINTS, [[np.nan] * 3, [0.0, 0, 0], [np.nan, 0, 1]]]).reshape(2, 3, 3)
    np.save(tmp_path / "image.npy", image)
    np.testing.assert_allclose(read_cloud(tmp_path / "image.npy", LIMIT).points, POINTS)
    for other in (0.0, np.nan, np.inf, -np.inf):
        np.save(tmp_path / "list.npy", np.concatenate([POINTS, np.full((1, 3), other)]))
        cloud = read_cloud(tmp_path / "list.npy", LIMIT)
        np.testing.assert_allclose(cloud.points, POINTS)
        assert cloud.notes == ("1 of 4 points without a reading (NaN, infinite or 0 0 0) left out",)


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_points_with_unusable_normals(bad: float, tmp_path: Path) -> None:
    """A few: these points are left out. Most: there are no normals, and it is said."""
    normals = NORMALS.copy()
    normals[1] = bad
    np.savez(tmp_path / "a.npz", points=POINTS, normals=normals)
    cloud = read_cloud(tmp_path / "a.npz", LIMIT)
    np.testing.assert_array_equal(cloud.points, POINTS[[0, 2]])
    assert cloud.notes == ("normals NaN, infinite or of length 0 in 1 of 3 points: these points left out",)
    normals[2] = bad
    np.savez(tmp_path / "a.npz", points=POINTS, normals=normals)
    cloud = read_cloud(tmp_path / "a.npz", LIMIT)
    assert len(cloud) == 3
    assert cloud.normals is None
    assert cloud.notes[0].startswith("normals NaN, infinite or of length 0 in 2 of 3 points: estimated instead")


def test_shapes_and_types_of_arrays(tmp_path: Path) -> None:
    """Half and quadruple columns, other byte orders, whole numbers, fields by name as ROS and pyntcloud have them."""
    fields = np.zeros(
        3, [("X", ">f4"), ("y", "f8"), ("z", "f4"), ("rgb", "u4"), *((f"normal_{a}", "f4") for a in "xyz")]
    )
    for i, axis in enumerate("Xyz"):
        fields[axis], fields[f"normal_{axis.lower()}"] = POINTS[:, i], NORMALS[:, i]
    vector = np.zeros(3, [("xyz", "f4", (3,)), ("rgb", "u4")])
    vector["xyz"] = POINTS
    homogeneous = np.hstack([POINTS, np.ones((3, 1))])
    for array in (fields, vector, homogeneous, POINTS.astype(">f4"), np.asfortranarray(POINTS), homogeneous[:, None]):
        np.save(tmp_path / "a.npy", array)
        cloud = read_cloud(tmp_path / "a.npy", LIMIT)
        np.testing.assert_allclose(cloud.points, POINTS, atol=1e-6)
        assert (cloud.normals is None) == (array is not fields)
    np.save(tmp_path / "a.npy", (1000 * POINTS).astype(np.int16))
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.npy", LIMIT).points, 1000 * POINTS)


@pytest.mark.parametrize("name", ["xyz", "pc", "arr_0", "unheard_of"])
def test_an_array_of_another_name(name: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", **{name: POINTS, "rgb": np.zeros((3, 3), np.uint8)})
    cloud = read_cloud(tmp_path / "a.npz", LIMIT)
    np.testing.assert_array_equal(cloud.points, POINTS)
    assert cloud.notes == (f"array {name} taken for the points",)


def saved(array: object) -> Callable[[Path], None]:
    return lambda path: np.save(path, array)  # type: ignore[arg-type, return-value]


def zipped(**arrays: object) -> Callable[[Path], None]:
    return lambda path: np.savez(path, **arrays)  # type: ignore[arg-type]


def written(content: bytes | str) -> Callable[[Path], None]:
    return lambda path: (path.write_bytes(content if isinstance(content, bytes) else content.encode()), None)[1]


NAN = POINTS * np.array([[1.0], [np.nan], [1.0]])
BINARY = ply("binary_little_endian", BOTH, "x y z nx ny nz")
ASCII = ply("ascii", BOTH, "x y z nx ny nz")


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("a.npy", saved(np.zeros((0, 3))), "expected points, got none"),
        ("a.ply", written(ply("ascii", POINTS[:0], "x y z")), "expected points, got none"),
        ("a.xyz", written("# nothing\n"), "expected points, got none"),
        ("a.xyz", written(""), "expected data, got an empty file"),
        ("a.npy", saved(np.full((2, 2, 3), np.nan)), "expected points, got none: all 4 are NaN, infinite or 0 0 0"),
        ("a.npz", zipped(points=POINTS, normals=300 * NORMALS), r"got lengths of 300 to 300 \(colours\?"),
        ("a.npy", saved(np.hstack([POINTS, 3 * NORMALS])), r"expected normals of length 1, got lengths of 3 to 3"),
        ("a.npy", saved(POINTS.astype(np.uint8)), "points: expected numbers, got uint8"),
        ("a.npy", saved(np.ones((3, 700))), r"expected shape \(N, 3\).*transpose it"),
        ("a.npy", saved(np.hstack([POINTS, POINTS[:, :1]])), "expected 3 columns x y z or 6 with normals"),
        ("a.npy", saved(np.zeros(3, [("u", "f4"), ("v", "f4")])), "expected columns named x, y, z .*; got u, v"),
        ("a.npz", zipped(points=POINTS, normals=NORMALS[:2]), "expected points and normals of one shape"),
        ("a.npz", zipped(a=POINTS, b=POINTS), r"expected an array named points, got a \(3, 3\), b \(3, 3\); save"),
        (
            "a.npz",
            zipped(points=POINTS, viewpoints=np.zeros((2, 6))),
            r"expected viewpoints of shape \(N, 3\), got \(2, 6\)",
        ),
        ("a.npy", saved(np.ones((9, 2))), r"expected shape \(N, 3\).*a depth image\? then give intrinsics"),
        ("a.npy", saved(np.array([{"x": 1}])), "got pickled Python objects, which can run code .* np.savez"),
        ("a.npy", written(pickle.dumps({"x": 1})), "got pickled Python objects"),
        ("a.npz", written(pickle.dumps({"x": 1})), "got pickled Python objects"),
        ("a.npz", zipped(points=np.array([{}])), "got pickled Python objects"),
        ("a.npy", saved(np.array([["a", "b", "c"]])), "expected numbers, got <U1"),
        ("a.npy", written(b"\x93NUMPY\x01\x00v\x00{'descr': '<f8'"), "expected a whole numpy file"),
        ("a.npz", written(b"PK\x03\x04 half a zip"), "expected a whole numpy file"),
        ("a.npy", saved(np.ones((LIMIT + 1, 3))), r"at most 1000 points \(max_points\), got 1001; thin"),
        ("a.ply", written(ply("ascii", np.ones((LIMIT + 1, 3)), "x y z")), "at most 1000 points"),
        ("a.xyz", written("1 2 3\n" * (LIMIT + 5)), "at most 1000 points"),
        ("a.ply", written(BINARY[:-20]), "expected 3 of vertex as its header says, got 2: the file is cut"),
        (
            "a.ply",
            written(BINARY[: BINARY.index(b"end_header")]),
            "expected a PLY header that ends with end_header, got a",
        ),
        ("a.ply", written("solid\n"), "expected a PLY header that ends with end_header, got none"),
        ("a.ply", written(ASCII[:-30]), "cut"),
        ("a.ply", written(ASCII[: len(ASCII) // 2 + 60]), "cut"),
        (
            "a.ply",
            written(ply("ascii", POINTS[:, :2], "x y")),
            "expected vertices with properties x, y and z, got x, y",
        ),
        (
            "a.ply",
            written(ASCII.replace(b"uchar red", b"bool red")),
            "property red: expected a type .*, got bool; write",
        ),
        ("a.ply", written(ASCII.replace(b"0.25", b"a.25")), "expected numbers after the header .*, got other words"),
        ("a.xyz", written("1 2 3\n4 5\n"), "expected rows of numbers"),
        ("a.xyz", written("1 2 3\n4 five 6\n"), "expected rows of numbers.*five"),
        ("a.xyz", written(bytes(range(128, 256))), "expected rows of numbers"),
        ("a.xyz", written("1 2 3 4\n"), "expected 3 columns x y z or 6 with normals .*, got 4"),
        ("a.csv", written("u,v,w\n1,2,3\n"), "expected columns named x, y, z .*; got u, v, w"),
        ("a.las", written("1 2 3\n"), "expected a point cloud"),
    ],
)
def test_bad_input_is_named(name: str, write: Callable[[Path], None], message: str, tmp_path: Path) -> None:
    write(tmp_path / name)
    with pytest.raises(InputError, match=message) as caught:
        read_cloud(tmp_path / name, LIMIT)
    assert str(tmp_path / name) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_or_nothing_for_a_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a file, got a folder"):
        read_cloud(tmp_path, LIMIT)
    with pytest.raises(InputError, match="expected a file, got nothing there"):
        read_cloud(tmp_path / "none.ply", LIMIT)


@pytest.mark.parametrize("cut", [0.3, 0.6, 0.9])
def test_numpy_cut_in_half(cut: float, tmp_path: Path) -> None:
    for name, write in (("a.npy", saved(BOTH.repeat(50, axis=0))), ("a.npz", zipped(points=POINTS.repeat(50, axis=0)))):
        write(tmp_path / name)
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(whole[: int(cut * len(whole))])
        with pytest.raises(InputError, match="expected a whole numpy file of numbers, got a damaged one"):
            read_cloud(tmp_path / name, LIMIT)


def test_voxel_means_equal_a_slow_loop(rng: np.random.Generator) -> None:
    points = rng.random((500, 3)) * 0.02
    normals = rng.normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    axes = principal_axes(points)
    along, facing = points @ axes.T, normals @ axes.T
    cells: dict[tuple, list[int]] = {}
    for i, (point, normal) in enumerate(zip(along, facing, strict=True)):
        axis = int(np.abs(normal).argmax())
        cells.setdefault((*((point - along.min(axis=0)) // 0.004), axis, normal[axis] > 0), []).append(i)
    thinned = voxel_means(Cloud(points, normals), 0.004)
    assert 100 < len(cells) < 500
    np.testing.assert_allclose(thinned.points, [points[each].mean(axis=0) for each in cells.values()])
    means = np.array([normals[each].mean(axis=0) for each in cells.values()])
    np.testing.assert_allclose(thinned.normals, means / np.linalg.norm(means, axis=1, keepdims=True))


def test_voxel_means_turn_with_the_cloud(rng: np.random.Generator) -> None:
    points = rng.random((500, 3)) ** 2 * [0.03, 0.02, 0.01]
    R = np.array([[0.6, -0.8, 0], [0, 0, -1], [0.8, 0.6, 0]])
    means = voxel_means(Cloud(points), 0.004).points
    moved = voxel_means(Cloud(points @ R.T + [1, -2, 3]), 0.004).points
    assert 50 < len(means) < 400
    np.testing.assert_allclose(moved, means @ R.T + [1, -2, 3], atol=1e-9)


def test_voxels_keep_both_sides_of_a_sheet() -> None:
    """Two points 0.5 mm apart in one cell of 2 mm, back to back: kept apart with normals, else merged."""
    points, normals = np.array([[0.0, 0, 0], [0, 0, 0.0005]]), np.array([[0.0, 0, -1], [0, 0, 1]])
    assert len(voxel_means(Cloud(points, normals), 0.002)) == 2
    np.testing.assert_allclose(voxel_means(Cloud(points), 0.002).points, [[0, 0, 0.00025]])


FACES = "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
VERTICES = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
CORNERS = "1 0 0\n0 1 0\n0 0 1\n1 1 1\n"


def test_ply_with_other_things_in_it(tmp_path: Path) -> None:
    """Faces, upper case, lists among the vertices (of one length, or not), line breaks anywhere, elements before."""
    path = tmp_path / "a.ply"
    lists = VERTICES + "property list uchar int seen_by\n" + FACES
    faces = "3 0 1 2\n3 1 2 3\n"
    before = VERTICES.replace("element vertex", "element note 2\nproperty list uchar float a\nelement vertex") + FACES
    for content in (
        VERTICES + FACES + CORNERS + faces,
        (VERTICES + FACES).replace(" x\n", " X\n").replace(" y\n", " Y\n") + CORNERS + faces,
        lists + CORNERS.replace("\n", " 2 5 6\n") + faces,
        lists + "1 0 0 0\n0 1 0 2 5 6\n0 0 1 1 7\n1 1 1 0\n" + faces,
        VERTICES + "property uchar red\n" + FACES + CORNERS.replace("\n", "\n255\n") + faces,
        before + "1 0.5\n2 0.5 0.5\n" + CORNERS + faces,
        (VERTICES + FACES + CORNERS + faces).replace("\n", "\r"),
    ):
        path.write_bytes(content.encode())
        np.testing.assert_array_equal(read_cloud(path, LIMIT).points, [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])


@pytest.mark.parametrize("lengths", [(2, 2, 2, 2), (0, 2, 1, 3)])
@pytest.mark.parametrize("order", ["little", "big"])
def test_binary_ply_with_lists(lengths: tuple[int, ...], order: str, tmp_path: Path) -> None:
    head = (VERTICES + "property list uchar int seen_by\n").replace("ascii", f"binary_{order}_endian") + "end_header\n"
    mark = "<" if order == "little" else ">"
    corners = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
    rows = [
        corner.astype(mark + "f4").tobytes() + bytes([n]) + np.arange(n).astype(mark + "i4").tobytes()
        for corner, n in zip(corners, lengths, strict=True)
    ]
    path = tmp_path / "a.ply"
    path.write_bytes(head.encode() + b"".join(rows))
    np.testing.assert_array_equal(read_cloud(path, LIMIT).points, corners)
    path.write_bytes(head.encode() + b"".join(rows)[:-3])
    with pytest.raises(InputError, match="expected 4 of vertex as its header says, got 3: the file is cut"):
        read_cloud(path, LIMIT)


def test_the_camera_of_a_ply_is_its_viewpoint_unless_it_is_the_origin(tmp_path: Path) -> None:
    camera = "element camera 1\n" + "".join(f"property float view_p{axis}\n" for axis in "xyz") + "end_header\n"
    for words, viewpoints in (("1 2 3", [[1, 2, 3]]), ("0 0 0", None)):
        (tmp_path / "a.ply").write_text(VERTICES + camera + CORNERS + words + "\n")
        cloud = read_cloud(tmp_path / "a.ply", LIMIT)
        assert (None if cloud.viewpoints is None else cloud.viewpoints.tolist()) == viewpoints


def test_meshes_in_ply(tmp_path: Path) -> None:
    """Upper case is read; only what is damaged is called so."""
    path, faces = tmp_path / "a.ply", "3 0 1 2\n3 1 2 3\n"
    path.write_text((VERTICES + FACES).replace(" x\n", " X\n") + CORNERS + faces)
    assert [array.shape for array in mesh_arrays(path)] == [(4, 3), (2, 3)]
    for content, message in (
        (
            VERTICES + "property uchar red\n" + FACES + CORNERS.replace("\n", "\n5\n") + faces,
            "a layout that is not read",
        ),
        (VERTICES + "property bool ok\n" + FACES + CORNERS + faces, "property ok: expected a type .* got bool"),
        (VERTICES + FACES + CORNERS + faces[:8], r"expected 4 vertices and 2 faces as its header says, got \(4, 1\)"),
    ):
        path.write_text(content)
        with pytest.raises(InputError, match=message) as caught:
            mesh_arrays(path)
        assert "damaged" not in str(caught.value)
