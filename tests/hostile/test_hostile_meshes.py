"""Mesh files that are damaged, foreign, too large or made to hurt: given to `predict`, and as objects to `train`."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hostile import Case, Write, lines, nothing, raw, refused, table

HUGE = 10**12
TRIANGLE = ("v 0 0 0", "v .1 0 0", "v 0 .1 0")


def ply_mesh(vertices: object = 3, faces: object = 1, body: bytes = b"0 0 0\n.1 0 0\n0 .1 0\n3 0 1 2\n") -> Write:
    head = f"""ply
format ascii 1.0
element vertex {vertices}
property float x
property float y
property float z
element face {faces}
property list uchar int vertex_indices
end_header
"""
    return raw(head.encode() + body)


def stl(count: int, body: bytes) -> Write:
    return raw(bytes(80) + struct.pack("<I", count) + body)


def glb(document: Any, binary: bytes = b"", mark: bytes = b"glTF", length: int | None = None) -> Write:
    text = (document if isinstance(document, str) else json.dumps(document)).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text) if length is None else length) + b"JSON" + text
    chunks += struct.pack("<I", len(binary)) + b"BIN\x00" + binary
    return raw(mark + struct.pack("<II", 2, 12 + len(chunks)) + chunks)


def gltf(**changes: Any) -> dict[str, Any]:
    """One triangle, as a document; its buffer is `CORNERS`."""
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": 42}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 6},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        **changes,
    }


CORNERS = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], "<f4").tobytes() + struct.pack("<HHH", 0, 1, 2)


def accessors(count: object, index: int = 0, view: bool = False) -> list[dict[str, Any]]:
    listed = gltf()["accessors"]
    listed[index] = {**listed[index], "count": count}
    if not view:
        del listed[index]["bufferView"]
    return listed


def many_nodes() -> dict[str, Any]:
    """A mesh of 30,000 faces, shown ten thousand times."""
    return gltf(
        nodes=[{"mesh": 0}] * 10_000,
        scenes=[{"nodes": list(range(10_000))}],
        bufferViews=[
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 180_000},
        ],
        accessors=[gltf()["accessors"][0], {**gltf()["accessors"][1], "count": 90_000}],
    )


def box(scale: float = 1.0, move: float = 0.0) -> trimesh.Trimesh:
    return trimesh.creation.box((0.1 * scale,) * 3).apply_translation((move, 0, 0))


def saved(mesh: trimesh.Trimesh) -> Write:
    return lambda path: mesh.export(path)


MESHES = [
    ("a.obj", "empty", raw(b""), "empty"),
    ("a.obj", "bytes", raw(bytes(range(256)) * 10), ""),
    ("a.obj", "no face", lines(*TRIANGLE), "faces"),
    ("a.obj", "a face of vertices that are not there", lines(*TRIANGLE, "f 1 2 99"), "a.obj"),
    ("a.obj", "a face of vertex -99", lines(*TRIANGLE, "f 1 2 -99"), "a.obj"),
    ("a.obj", "a face of a vertex of a trillion", lines(*TRIANGLE, f"f 1 2 {HUGE}"), "a.obj"),
    ("a.obj", "a face in words", lines(*TRIANGLE, "f a b c"), "a.obj"),
    ("a.obj", "vertices in words", lines("v a b c", "v 1 0 0", "v 0 1 0", "f 1 2 3"), "a.obj"),
    ("a.obj", "NaN", lines("v nan 0 0", *TRIANGLE[1:], "f 1 2 3"), "a.obj"),
    ("a.obj", "beyond float", lines("v 1e999 0 0", *TRIANGLE[1:], "f 1 2 3"), "a.obj"),
    ("a.obj", "near the largest", lines("v 1e300 0 0", *TRIANGLE[1:], "f 1 2 3"), "extent"),
    ("a.obj", "a flat point", lines(*["v 0 0 0"] * 3, "f 1 2 3"), "extent"),
    ("a.stl", "half a header", raw(bytes(50)), "a.stl"),
    ("a.stl", "four billion faces", stl(2**32 - 1, bytes(100)), "a.stl"),
    ("a.stl", "no faces", stl(0, b""), "faces"),
    ("a.stl", "faces cut", stl(2, bytes(70)), "a.stl"),
    ("a.stl", "NaN", stl(1, struct.pack("<12f", *[float("nan")] * 12) + b"\0\0"), "NaN"),
    ("a.stl", "text without a facet", lines("solid a", "endsolid a"), ""),
    ("a.stl", "text cut in a facet", lines("solid a", "facet normal 0 0 1", "outer loop", "vertex 0 0 0"), "a.stl"),
    ("a.stl", "words for numbers", lines("solid a", "facet normal 0 0 1", "outer loop", *["vertex a b c"] * 3,
                                         "endloop", "endfacet", "endsolid"), ""),
    ("a.ply", "a trillion faces", ply_mesh(faces=HUGE), ""),
    ("a.ply", "a trillion vertices", ply_mesh(vertices=HUGE), ""),
    ("a.ply", "faces of vertices that are not there", ply_mesh(body=b"0 0 0\n.1 0 0\n0 .1 0\n3 0 1 9\n"), "a.ply"),
    ("a.ply", "a face of -1", ply_mesh(body=b"0 0 0\n.1 0 0\n0 .1 0\n3 0 1 -1\n"), "a.ply"),
    ("a.ply", "cut", ply_mesh(body=b"0 0 0\n.1 0"), "a.ply"),
    ("a.ply", "two million lines fewer than said", ply_mesh(faces=2_000_000), ""),
    ("a.off", "no OFF", lines("NOFF", "3 1 0"), "a.off"),
    ("a.off", "no counts", lines("OFF"), "damaged"),
    ("a.off", "a trillion vertices", lines("OFF", f"{HUGE} 1 0", "0 0 0"), "damaged"),
    ("a.off", "counts of a thousand digits", lines("OFF", "9" * 1000 + " 1 0"), "damaged"),
    ("a.off", "negative counts", lines("OFF", "-3 -1 0", "0 0 0"), ""),
    ("a.off", "a face of vertex 9", lines("OFF", "3 1 0", "0 0 0", "1 0 0", "0 1 0", "3 0 1 9"), "damaged"),
    ("a.glb", "cut", raw(b"glTF\x02\x00\x00\x00"), "damaged"),
    ("a.glb", "another mark", glb(gltf(), CORNERS, mark=b"glXX"), "damaged"),
    ("a.glb", "JSON longer than the file", glb(gltf(), CORNERS, length=2**31), "JSON"),
    ("a.glb", "JSON of brackets", glb("[" * 100_000), "glb"),
    ("a.glb", "JSON that is none", glb("{hello"), "glb"),
    ("a.glb", "a list", glb([]), "damaged"),
    ("a.glb", "empty", glb({}), ""),
    ("a.glb", "a trillion vertices of zeros", glb(gltf(accessors=accessors(HUGE)), CORNERS), "elements"),
    ("a.glb", "a hundred million vertices of zeros", glb(gltf(accessors=accessors(10**8)), CORNERS), "elements"),
    ("a.glb", "a negative count", glb(gltf(accessors=accessors(-3)), CORNERS), ""),
    ("a.glb", "a count in words", glb(gltf(accessors=accessors("three", view=True)), CORNERS), "damaged"),
    ("a.glb", "more vertices than bytes", glb(gltf(accessors=accessors(30, view=True)), CORNERS), "damaged"),
    ("a.glb", "a mesh ten thousand times", glb(many_nodes(), CORNERS[:36] + bytes(180_000)), "at most"),
    ("a.glb", "nodes in a ring", glb(gltf(nodes=[{"children": [1]}, {"children": [0]}]), CORNERS), ""),
    ("a.glb", "nodes that are not there", glb(gltf(scenes=[{"nodes": [7]}]), CORNERS), "damaged"),
    ("a.glb", "a buffer elsewhere", glb(gltf(buffers=[{"byteLength": 42, "uri": "../../../etc/passwd"}])), ""),
    ("a.glb", "a buffer on the net", glb(gltf(buffers=[{"byteLength": 42, "uri": "https://example.com/a"}])), ""),
    ("a.glb", "a matrix of NaN", glb(gltf(nodes=[{"mesh": 0, "matrix": [float("nan")] * 16}]), CORNERS), ""),
    ("a.ply", "in millimetres", saved(box(1000)), "unit=mm"),
    ("a.stl", "around its cameras", saved(box(15)), "cameras"),
]  # fmt: skip
OPEN = box()
OPEN.update_faces(np.arange(12) > 3)
WHOLE = [
    ("a.ply", "whole but open", saved(OPEN), "closed"),
    ("a.ply", "whole but inside out", saved(trimesh.Trimesh(box().vertices, box().faces[:, ::-1], process=False)),
     "inverted"),
    ("a.obj", "whole but a sheet", lines(*TRIANGLE, "f 1 2 3", "f 1 3 2"), "sheet"),
]  # fmt: skip
LISTED = [Case(f"{file}: {name}", {"input": file}, write, (word,)) for file, name, write, word in MESHES]
LISTED += [
    Case(f"{file}: {name}", {"input": file, "mesh": "whole"}, write, (file, word)) for file, name, write, word in WHOLE
]
LISTED += [Case("two meshes", {"input": ["a.obj", "a.obj"]}, nothing, ("one mesh",))]


@table(LISTED)
def test_a_mesh_to_look_at(case: Case, model_known: None, capsys: pytest.CaptureFixture) -> None:
    lines(*TRIANGLE, "f 1 2 3")(Path("a.obj"))
    given = case.changes["input"]
    if isinstance(given, str):
        case.write(Path(given))
    refused("predict", case.changes, (*case.words, "expected", "got"), capsys)


def manifest(*rows: str, head: str = "name,file,class") -> Write:
    def write(folder: Path) -> None:
        box().export(folder / "box.ply")
        (folder / "manifest.csv").write_bytes("\n".join([head, *rows, ""]).encode(errors="surrogateescape"))

    return write


def described(text: str) -> Write:
    return lambda folder: (folder / "mug.yaml").write_text(text)


def block(**changes: Any) -> Write:
    values = {"name": "mug", "category": "boxes", "mass": 0.2, "shape": "box", "dimensions": {"size": [0.1, 0.1, 0.1]}}
    return described(json.dumps({**values, **changes}))


LAUGHS = "a: &a [lol, lol, lol, lol, lol, lol, lol, lol, lol]\n" + "".join(
    f"{y}: &{y} [{', '.join([f'*{x}'] * 9)}]\n" for x, y in zip("abcdefghi", "bcdefghij", strict=True)
)
MERGES = "a: &a {k: v}\n" + "".join(
    f"{y}: &{y} {{<<: [{', '.join([f'*{x}'] * 9)}]}}\n" for x, y in zip("abcdefghi", "bcdefghij", strict=True)
)
OBJECTS: list[tuple[str, Write, str]] = [
    ("an empty folder", lambda folder: None, "mesh"),
    ("meshes and descriptions", lambda folder: (manifest("box,box.ply,box")(folder), block()(folder)), "both"),
    ("a manifest without names", manifest("box,box.ply,box", head="a,b,c"), "name"),
    ("a manifest without a row", manifest(), "line"),
    ("a manifest of bytes", lambda folder: (folder / "manifest.csv").write_bytes(bytes(range(256))), "manifest.csv"),
    ("a manifest of one long cell", manifest("a" * 200_000 + ",box.ply,box"), "manifest.csv"),
    ("a manifest whose file climbs", manifest("box,../../secret.ply,box"), "below"),
    ("a manifest with an absolute file", manifest("box,/etc/passwd.ply,box"), "below"),
    ("a manifest with a file of another kind", manifest("box,/dev/zero,box"), "below"),
    ("a manifest with a name too long", manifest("a" * 300 + ",box.ply,box"), "characters"),
    ("a manifest with a file too long", manifest("box," + "a" * 3000 + ".ply,box"), "nothing there"),
    ("a manifest with a name that climbs", manifest("../../box,box.ply,box"), "letters"),
    ("a manifest with a name of two lines", manifest('"bo\nx",box.ply,box'), "letters"),
    ("a manifest with a name of slashes", manifest("a/b,box.ply,box"), "letters"),
    ("a manifest with an escape", manifest("\x1b[2J,box.ply,box"), "letters"),
    ("a manifest with a name twice", manifest("box,box.ply,box", "box,box.ply,box"), "once"),
    ("a manifest with an unknown class", manifest("box,box.ply,bowl"), "class"),
    ("a manifest with a mass below 0", manifest("box,box.ply,box,-1", head="name,file,class,mass"), "mass"),
    ("a manifest with an infinite mass", manifest("box,box.ply,box,inf", head="name,file,class,mass"), "mass"),
    ("a torn mesh", lambda f: (manifest("box,box.ply,box")(f), (f / "box.ply").write_bytes(b"ply\n")), "box.ply"),
    ("not YAML", described("name: [mug"), "mug.yaml"),
    ("an empty description", described("\n"), "mapping"),
    ("a list", described("- 1"), "mapping"),
    ("a tag that makes an object", described("!!python/object/apply:os.system ['touch outputs/ran']"), "mug.yaml"),
    ("a tag in a value", described("name: !!python/name:os.system x"), "mug.yaml"),
    ("a tag without its value", described("name: !!timestamp x"), "mug.yaml"),
    ("an integer of 5000 digits", described("mass: " + "9" * 5000), "mug.yaml"),
    ("a billion laughs", described(LAUGHS), "aliases"),
    ("a billion merges", described(MERGES), "aliases"),
    ("an alias within itself", described("name: &a [*a]"), "alias"),
    ("brackets without end", described("[" * 100_000), "mug.yaml"),
    ("sixty levels", described("[" * 60 + "]" * 60), "levels"),
    ("five megabytes", described("# a comment\n" * 500_000), "bytes"),
    ("bytes", lambda folder: (folder / "mug.yaml").write_bytes(bytes(range(128, 256))), "mug.yaml"),
    ("a missing key", described("name: mug"), "mug.yaml"),
    ("an unknown key", block(_target_="os.system"), "_target_"),
    ("a key of numbers", described("{1: 2}"), "mug.yaml"),
    ("a name that reads the environment", block(name="${oc.env:HOME}"), "plain"),
    ("a name that climbs", block(name="../../mug"), "letters"),
    ("an absolute name", block(name="/tmp/mug"), "letters"),
    ("a name of two lines", block(name="mu\ng"), "letters"),
    ("a name too long", block(name="m" * 300), "characters"),
    ("an empty name", block(name=""), "letters"),
    ("a mass of NaN", block(mass=float("nan")), "mass"),
    ("a mass in words", block(mass="heavy"), "mass"),
    ("an unknown class", block(category="bowls"), "category"),
    ("an unknown shape", block(shape="klein_bottle"), "shape"),
    ("two lengths", block(dimensions={"size": [0.1, 0.1]}), "size"),
    ("lengths in words", block(dimensions={"size": ["a", "b", "c"]}), "size"),
    ("lengths of infinity", block(dimensions={"size": [float("inf")] * 3}), "size"),
    ("unknown dimensions", block(dimensions={"weight": 3}), "weight"),
    ("dimensions that are none", block(dimensions=None), "dimensions"),
    ("a profile of words", block(shape="round_solid", dimensions={"profile": [["a", "b"]]}), "profile"),
    ("a profile of lists in lists", block(shape="round_solid", dimensions={"profile": [[[1]]]}), "profile"),
    ("radii of nothing", block(shape="bent", dimensions={"radii": [], "bend": 0.1, "angle_deg": 90}), "radii"),
]  # fmt: skip
FOLDERS = [Case(name, {"objects": "objects", "cache": "off"}, write, (word,)) for name, write, word in OBJECTS]
FOLDERS += [
    Case("a file for a folder", {"objects": "objects/a"}, lambda folder: (folder / "a").write_text(""), ("folder",)),
    Case("a folder with a name too long", {"objects": "o" * 5000}, lambda folder: None, ("too long",)),
]


@table(FOLDERS)
def test_a_folder_of_objects(case: Case, capsys: pytest.CaptureFixture) -> None:
    Path("objects").mkdir()
    case.write(Path("objects"))
    refused("train", case.changes, (*case.words, "expected", "got"), capsys)
