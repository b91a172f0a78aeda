"""Mesh files as they are: vertices and triangles, from this one file, bounded by its size."""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.files.ply import read_elements, read_header
from spgf_torch.files.reading import DEEPEST, LARGEST_JSON, existing, json_of, unreadable

# A scene may show one mesh many times over: a file of a megabyte could expand to billions of triangles.
MOST_FACES = 20_000_000
MOST_COPIES = 1_000_000  # vertices and corners of what a GLB shows beyond the bytes that it has
MOST_PARTS = 20_000  # nodes, primitives
MOST_COUNT = 1e15


def mesh_arrays(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """(V, 3) float64 vertices and (F, 3) int64 triangles as the file has them; no triangles for a point cloud.

    Materials, textures and other files that it names stay closed.

    Raises InputError, which names the file, for one that is damaged, has triangles of vertices that it lacks, or
    expands to more than `MOST_FACES` triangles.
    """
    kind = existing(path).suffix.lower().removeprefix(".")
    settings: dict[str, Any] = {}
    if kind == "glb":
        _check_glb(path)
    elif kind == "ply":
        read_header(path)  # which names what trimesh would call damaged
        settings["fix_texture"] = False  # it gives each corner of a face a vertex of its own
    try:
        with _ply_in_lower_case(path) if kind == "ply" else path.open("rb") as stream:
            scene = trimesh.load_scene(
                stream, kind, resolver=_NoOtherFile(), process=False, skip_materials=True, **settings
            )
        if (count := sum(_faces(scene))) > MOST_FACES:
            raise InputError(f"{path}: expected at most {MOST_FACES} faces, got {count}")
        loaded = scene.to_geometry()
        vertices = np.asarray(getattr(loaded, "vertices", np.empty((0, 3))), dtype=np.float64).reshape(-1, 3)
        faces = np.asarray(getattr(loaded, "faces", np.empty((0, 3))), dtype=np.int64).reshape(-1, 3)
    except InputError:
        raise
    except Exception as error:  # each format's reader raises its own kinds for a damaged file
        words = "a layout that is not read" if kind == "ply" and _has_vertices(path) else "a damaged file"
        raise unreadable(path, f"a {path.suffix} mesh", error, words) from error
    if kind == "ply":
        header = ply_header(path)
        said, got = (declared(header, "vertex"), declared(header, "face")), (len(vertices), len(faces))
        if got[0] != said[0] or got[1] < said[1]:  # faces of more than three corners become several
            raise InputError(f"{path}: expected {said[0]} vertices and {said[1]} faces as its header says, got {got}")
    if faces.size and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise InputError(f"{path}: expected faces of its {len(vertices)} vertices, got one of vertex {faces.max()}")
    return vertices, faces


def _ply_in_lower_case(path: Path) -> BinaryIO:
    """The bytes of a PLY file with its properties named as trimesh knows them; programs also write X Y Z."""
    stream = path.open("rb")
    head = stream.read(read_header(path).size)
    if head == head.lower():
        stream.seek(0)
        return stream
    with stream:
        return io.BytesIO(head.lower() + stream.read())


def _has_vertices(path: Path) -> bool:
    """Whether the vertices and the faces of a PLY file are all there, wherever its lines are broken."""
    try:
        read_elements(path, read_header(path), ("vertex", "face"))
    except InputError:
        return False
    return True


def ply_faces(path: Path) -> int:
    """Number of faces that a PLY file declares: 0 for a point cloud."""
    return declared(ply_header(path), "face")


def ply_header(path: Path) -> str:
    """The header of a PLY file, as text."""
    with path.open("rb") as stream:
        head = stream.read(1 << 16)
    text, found, _ = head.partition(b"end_header")
    if not head.startswith(b"ply") or not found:
        got = "a part of one" if head.startswith(b"ply") else "none"
        raise InputError(f"{path}: expected a PLY header that ends with end_header, got {got}")
    return text.decode("ascii", errors="replace")


def declared(header: str, element: str) -> int:
    """How many of an element a PLY header declares."""
    match = re.search(rf"^element {element} (\d{{1,18}})\s*$", header, re.MULTILINE)  # more digits are no count
    return int(match[1]) if match else 0


class _NoOtherFile(trimesh.resolvers.Resolver):
    """What a mesh refers to is not there."""

    def __init__(self) -> None:
        pass

    def get(self, name: str) -> bytes:
        raise FileNotFoundError(name)

    def write(self, name: str, data: Any) -> None:
        raise PermissionError(name)

    def namespaced(self, namespace: str) -> _NoOtherFile:
        return self

    def keys(self) -> Iterator[str]:
        return iter(())


def _faces(scene: trimesh.Scene) -> Iterator[int]:
    """The number of faces of each mesh that a scene shows, as often as it shows it."""
    for node in scene.graph.nodes_geometry:
        yield len(getattr(scene.geometry[scene.graph[node][1]], "faces", ()))


def _check_glb(path: Path) -> None:
    """InputError for accessors that promise more elements than the file has bytes: zeros are made for them."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(20)
        if len(head) < 20 or head[:4] != b"glTF":
            raise InputError(f"{path}: expected a .glb mesh, got a damaged file (no glTF header)")
        length = struct.unpack("<I", head[12:16])[0]
        if length > min(size, LARGEST_JSON):
            raise InputError(f"{path}: expected a .glb mesh with at most {LARGEST_JSON} bytes of JSON, got {length}")
        header = json_of(stream.read(length), path, "a .glb mesh")
    _check_elements(path, size, header)


def _check_elements(path: Path, size: int, header: Any) -> None:
    """InputError for a scene that becomes much larger than its file: its primitives may share what they are made of,
    its nodes their meshes.
    """
    counts = [_whole(a.get("count")) for a in _listed(header, "accessors")]
    if sum(counts) > size:
        raise InputError(f"{path}: expected accessors that its {size} bytes can hold, got {sum(counts)} elements")
    meshes, nodes = _listed(header, "meshes"), _listed(header, "nodes")
    primitives = [_listed(mesh, "primitives") for mesh in meshes]
    parts = sum(map(len, primitives))
    if len(nodes) > MOST_PARTS or parts > MOST_PARTS:
        raise InputError(f"{path}: expected at most {MOST_PARTS} nodes and primitives, got {len(nodes)} and {parts}")
    each = [sum(_elements(primitive, counts) for primitive in of_mesh) for of_mesh in primitives]
    shown = sum(each[at] for node in nodes if 0 <= (at := _whole(node.get("mesh"), -1)) < len(each))
    if (total := max(shown, sum(each))) > size + MOST_COPIES:
        raise InputError(
            f"{path}: expected meshes of at most {size + MOST_COPIES} elements, however often each is used, got {total}"
        )
    if _levels(nodes) > DEEPEST:
        raise InputError(f"{path}: expected nodes in at most {DEEPEST} levels, got more")


def _elements(primitive: dict[str, Any], counts: list[int]) -> int:
    """Count the vertices and corners of a primitive."""
    attributes = primitive.get("attributes")
    asked = [*attributes.values()] if isinstance(attributes, dict) else []
    known = [_whole(at, -1) for at in [*asked, primitive.get("indices")]]
    return sum(counts[at] for at in known if 0 <= at < len(counts))


def _levels(nodes: list[dict[str, Any]]) -> int:
    """How deep nodes stand within each other, as far as it is bounded; more where they stand in a ring."""
    below = [[_whole(at, -1) for at in _list(node.get("children"))] for node in nodes]
    level, depth = set(range(len(nodes))), 0
    while level and depth <= DEEPEST:
        level, depth = {at for i in level for at in below[i] if 0 <= at < len(nodes)}, depth + 1
    return depth


def _listed(values: Any, key: str) -> list[dict[str, Any]]:
    """The mappings in a list of the header."""
    listed = _list(values.get(key)) if isinstance(values, dict) else []
    return [part if isinstance(part, dict) else {} for part in listed]


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _whole(value: Any, otherwise: int = 0) -> int:
    """A count or an index; damaged ones are left to the parser."""
    return int(value) if isinstance(value, int | float) and abs(value) < MOST_COUNT else otherwise
