"""Readers of files that are written elsewhere or by this package: bombs, odd types, and what no format allows."""

import io
import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hostile import bounded, tree

from spgf_torch.errors import InputError
from spgf_torch.files.mesh_files import mesh_arrays
from spgf_torch.files.parquet import parquet_table
from spgf_torch.files.reading import npy_array, npz_arrays, xml_root, yaml_values

Make = Callable[[], bytes]
BIG = 2**61 - 1  # Python's hash of whole numbers is the rest of them by this


def refused(read: Callable[[], Any], name: str, word: str) -> None:
    """One line that names the file, within bounds; nothing is written."""
    before = tree()
    with pytest.raises(InputError) as told, bounded():
        read()
    line = str(told.value)
    assert "\n" not in line and line.isprintable() and len(line) < 600, line
    assert name in line and "expected" in line and word in line, line
    assert tree() == before


def header(shape: object, descr: object = "<f8", version: int = 1) -> bytes:
    text = str({"descr": descr, "fortran_order": False, "shape": shape}).encode() + b"\n"
    length = struct.pack("<H" if version == 1 else "<I", len(text))
    return b"\x93NUMPY" + bytes([version, 0]) + length + text


def zipped(content: bytes, name: str = "points.npy") -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)
    return stream.getvalue()


def crowd() -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for i in range(25_000):
            archive.writestr(f"{i}.npy", b"")
    return stream.getvalue()


NPZ: dict[str, tuple[Make, str]] = {
    "items of 20 MB": (lambda: zipped(header((3,), "|V20000000") + bytes(60_000_000)), "plain numbers"),
    "items that are arrays": (lambda: zipped(header((3,), ("<f8", (1_000_000,))) + bytes(24_000_000)), ""),
    "items with fields": (lambda: zipped(header((3,), [("x", "<f8", (1000,))]) + bytes(24_000)), "plain numbers"),
    "long text": (lambda: zipped(header((3,), "<U5000000") + bytes(60_000_000)), "plain numbers"),
    "long bytes": (lambda: zipped(header((3,), "|S20000000") + bytes(60_000_000)), "plain numbers"),
    "dates": (lambda: zipped(header((3,), "<M8[s]") + bytes(24)), "plain numbers"),
    "complex numbers": (lambda: zipped(header((3,), "<c16") + bytes(48)), "plain numbers"),
    "objects": (lambda: zipped(header((3,), "|O") + bytes(24)), "np.savez"),
    "a header of 200 MB": (
        lambda: zipped(b"\x93NUMPY\x02\x00" + struct.pack("<I", 200_000_000) + bytes(200_000_000)),
        "damaged",
    ),
    "a header of version 9": (lambda: zipped(b"\x93NUMPY\x09\x00" + bytes(200)), "damaged"),
    "a shape below 0": (lambda: zipped(header((-3,)) + bytes(24)), ""),
    "a shape of words": (lambda: zipped(header(("a",)) + bytes(24)), "damaged"),
    "more numbers than asked for": (lambda: zipped(header((200,)) + bytes(1600)), "at most 100"),
    "more bytes than numbers": (lambda: zipped(header((3,)) + bytes(30_000_000)), "damaged"),
    "25,000 names": (crowd, "list of"),
    "the end of a zip alone": (lambda: b"PK\5\6" + bytes(18), "points"),
    "no zip": (lambda: b"PK\3\4" + bytes(100), "damaged"),
    "a name of another case": (lambda: zipped(header((3,)) + bytes(24), "POINTS.NPY"), "points"),
    "a code in the header": (lambda: zipped(header(()).replace(b"()", b"(exit(),)")), ""),
}


@pytest.mark.parametrize("name", NPZ)
def test_npz(name: str) -> None:
    make, word = NPZ[name]
    Path("a.npz").write_bytes(make())
    refused(lambda: npz_arrays(Path("a.npz"), ("points",), 100), "a.npz", word)


NPY: dict[str, tuple[Make, str]] = {
    "objects": (lambda: header((3,), "|O") + bytes(24), "Python objects"),
    "objects among fields": (lambda: header((3,), [("x", "|O")]) + bytes(24), "Python objects"),
    "a header of 4 GB": (lambda: b"\x93NUMPY\x02\x00" + b"\xff" * 4 + bytes(100), "damaged"),
    "a header of 100 kB": (lambda: b"\x93NUMPY\x03\x00" + struct.pack("<I", 100_000) + bytes(100_000), "damaged"),
    "cut in its header": (lambda: header((3,))[:30], "damaged"),
    "cut in its numbers": (lambda: header((3,)) + bytes(20), "damaged"),
    "more than a file may have": (lambda: header((2**40, 2**30)) + bytes(24), "damaged"),
}


@pytest.mark.parametrize("name", NPY)
def test_npy(name: str) -> None:
    make, word = NPY[name]
    Path("a.npy").write_bytes(make())
    refused(lambda: npy_array(Path("a.npy")), "a.npy", word)


def parquet(columns: dict[str, Any], **how: Any) -> Make:
    def make() -> bytes:
        stream = io.BytesIO()
        pq.write_table(pa.table({name: values() for name, values in columns.items()}), stream, **how)
        return stream.getvalue()

    return make


def lying_page() -> bytes:
    """A column chunk that unpacks to a hundred times what the footer says of it."""
    stream = io.BytesIO()
    pq.write_table(
        pa.table({"x": np.zeros(30_000_000)}), stream, compression="zstd", use_dictionary=False, column_encoding="PLAIN"
    )
    content = stream.getvalue()
    size = pq.ParquetFile(io.BytesIO(content)).metadata.row_group(0).column(0).total_uncompressed_size
    return content.replace(varint(2 * size), varint(2 * 1000 | 1 << 62)[: len(varint(2 * size))])


def varint(value: int) -> bytes:
    found = bytearray()
    while value > 127:
        found.append(value & 127 | 128)
        value >>= 7
    return bytes([*found, value])


def footer(length: int) -> Make:
    return lambda: b"PAR1" + bytes(100) + struct.pack("<I", length) + b"PAR1"


FEW = {"x": lambda: np.zeros(9)}
PARQUET: dict[str, tuple[Make, str]] = {
    "600 columns": (parquet({f"c{i}": lambda: [0] for i in range(600)}), "columns"),
    "65 columns within one": (
        parquet({"x": lambda: pa.array([{f"c{i}": 0 for i in range(65)}])}),
        "columns",
    ),
    "2000 groups of rows": (parquet({"x": lambda: np.zeros(2000)}, row_group_size=1), "groups"),
    "more rows than may be": (parquet({"x": lambda: np.zeros(2_000_001, np.int8)}), "at most"),
    "lists": (parquet({"x": lambda: pa.array([[1, 2]])}), "one value a row"),
    "structures": (parquet({"x": lambda: pa.array([{"a": 1}])}), "one value a row"),
    "bytes of a fixed length": (parquet({"x": lambda: pa.array([b"ab"] * 9, pa.binary(2))}), "one value a row"),
    "a long word of a fixed length": (
        parquet({"x": lambda: pa.array([b"a" * 10**6] * 200, pa.binary(10**6))}),
        "one value a row",
    ),
    "large text": (parquet({"x": lambda: pa.array(["a" * 10**6] * 200, pa.large_string())}), "one value a row"),
    "bytes": (parquet({"x": lambda: pa.array([b"a" * 10**6] * 200)}), "one value a row"),
    "decimals": (parquet({"x": lambda: pa.array([1] * 9, pa.decimal128(38, 2))}), "one value a row"),
    "a long word": (parquet({"x": lambda: ["a" * 300]}), "letters"),
    "an escape in a word": (parquet({"x": lambda: ["\x1b[2J"]}), "printable"),
    "an escape in a column's name": (parquet({"\x1b[2J": lambda: [1]}), "printable"),
    "pages larger than the footer says": (lying_page, ""),
    "a footer of 2 GB": (footer(2**31), "footer"),
    "a footer of 5 MB": (footer(5_000_000), "footer"),
    "a footer longer than the file": (footer(2000), "damaged"),
    "a footer of zeros": (footer(100), "damaged"),
    "no end": (lambda: parquet(FEW)()[:-4], "damaged"),
    "no beginning": (lambda: b"XXXX" + parquet(FEW)()[4:200], "damaged"),
    "an encrypted one": (lambda: parquet(FEW)()[:-4] + b"PARE", "damaged"),
}


@pytest.mark.parametrize("name", PARQUET)
def test_parquet(name: str) -> None:
    make, word = PARQUET[name]
    Path("a.parquet").write_bytes(make())
    refused(lambda: parquet_table(Path("a.parquet"), "a table", None, 2_000_000), "a.parquet", word)


def chain(levels: int) -> str:
    return "a0: &a0 [1]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}]\n" for i in range(1, levels))


def merged(levels: int) -> str:
    return "a0: &a0 {k: v}\n" + "".join(
        f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 8)}]}}\n" for i in range(1, levels)
    )


YAML: dict[str, tuple[str, str]] = {
    "a hexadecimal number of 100,000 digits": ("a: 0x" + "f" * 100_000, "characters"),
    "a binary number of 100,000 digits": ("a: 0b" + "1" * 100_000, "characters"),
    "an octal number of 100,000 digits": ("a: 0" + "7" * 100_000, "characters"),
    "a number with 300,000 colons": ("a: 1" + ":59" * 300_000, "characters"),
    "a fraction with 300,000 colons": ("a: 1" + ":59" * 300_000 + ".5", "characters"),
    "a number of 100,000 underscores": ("a: 1" + "_" * 100_000 + "1", "characters"),
    "a tagged number of 5000 digits": ("a: !!int " + "9" * 5000, "characters"),
    "a fraction of 5000 digits": ("a: 1." + "9" * 5000, "characters"),
    "keys that fall on each other": ("\n".join(f"{i * BIG}: 0" for i in range(10, 40_000)), "a key"),
    "keys below 0 that do": ("\n".join(f"-{i * BIG}: 0" for i in range(10, 9000)), "a key"),
    "a key of infinity": (".inf: 1", "a key"),
    "a key of NaN": (".nan: 1", "a key"),
    "a key of a list": ("? [1, 2]\n: 3", ""),
    "aliases in 60 levels": (chain(60), "levels"),
    "aliases in 5000 levels": (chain(5000), "aliases"),
    "merges of merges": (merged(9), "aliases"),
    "a merge of itself": ("&a {<<: *a}", "alias"),
    "a merge of a number": ("<<: 5", ""),
    "an alias of nothing": ("a: *b", ""),
    "an anchor twice within itself": ("a: &a {b: &b [*a, *b]}", "alias"),
    "a value without its kind": ("a: !!float x", ""),
    "an object": ("a: !!python/object/new:os.system ['touch ran']", ""),
    "a module": ("a: !!python/module:os", ""),
    "a tuple": ("a: !!python/tuple [1]", ""),
    "a directive of another version": ("%YAML 9.9\n---\na: 1", ""),
    "two documents": ("a: 1\n---\nb: 2", ""),
    "a tab": ("a:\n\t- 1", ""),
}


@pytest.mark.parametrize("name", YAML)
def test_yaml(name: str) -> None:
    content, word = YAML[name]
    Path("a.yaml").write_text(content)
    refused(lambda: yaml_values(Path("a.yaml"), "settings"), "a.yaml", word)


LAUGHS = "<!DOCTYPE r [<!ENTITY a 'lol'>" + "".join(
    f"<!ENTITY {y} '{f'&{x};' * 10}'>" for x, y in zip("abcdefg", "bcdefgh", strict=True)
)
XML: dict[str, tuple[bytes, str]] = {
    "a document type": (b"<!DOCTYPE r><r/>", "document type"),
    "entities": (f"{LAUGHS}]><r>&h;</r>".encode(), ""),
    "an entity of a file": (b"<!DOCTYPE r [<!ENTITY a SYSTEM 'file:///etc/passwd'>]><r>&a;</r>", ""),
    "a document type in UTF-16": ("<?xml version='1.0' encoding='UTF-16'?><!DOCTYPE r><r/>".encode("utf-16"), ""),
    "a type from the net": (b"<!DOCTYPE r SYSTEM 'https://example.com/r.dtd'><r/>", "document type"),
    "60 levels": (b"<a>" * 60 + b"</a>" * 60, "levels"),
    "100,000 levels": (b"<a>" * 100_000 + b"</a>" * 100_000, ""),
    "an unknown encoding": (b"<?xml version='1.0' encoding='martian'?><r/>", ""),
    "20 MB": (b"<r>" + b" " * 20_000_000 + b"</r>", "bytes"),
    "nothing": (b"", ""),
    "two roots": (b"<r/><r/>", ""),
    "zeros": (bytes(100), ""),
}


@pytest.mark.parametrize("name", XML)
def test_xml(name: str) -> None:
    content, word = XML[name]
    refused(lambda: xml_root(content, Path("a.urdf"), "a URDF"), "a.urdf", word)


CORNERS = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], "<f4").tobytes() + struct.pack("<HHH", 0, 1, 2)


def glb(change: Callable[[dict[str, Any]], object], data: bytes = CORNERS) -> Make:
    def make() -> bytes:
        made: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "buffers": [{"byteLength": len(data)}],
            "bufferViews": [
                {"buffer": 0, "byteOffset": 0, "byteLength": 36},
                {"buffer": 0, "byteOffset": 36, "byteLength": len(data) - 36},
            ],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5123, "count": (len(data) - 36) // 2, "type": "SCALAR"},
            ],
        }
        change(made)
        text = json.dumps(made).encode()
        text += b" " * (-len(text) % 4)
        body = data + bytes(-len(data) % 4)
        chunks = struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(body)) + b"BIN\0" + body
        return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks

    return make


def shown(count: int) -> Callable[[dict[str, Any]], object]:
    nodes = {"nodes": [{"mesh": 0}] * count, "scenes": [{"nodes": list(range(count))}]}
    return lambda made: made.update(nodes)


def primitives(count: int) -> Callable[[dict[str, Any]], object]:
    return lambda made: made["meshes"][0].update(primitives=made["meshes"][0]["primitives"] * count)


def line_of_nodes(count: int) -> Callable[[dict[str, Any]], object]:
    nodes = [{"mesh": 0, "children": [i + 1]} for i in range(count - 1)] + [{"mesh": 0}]
    return lambda made: made.update(nodes=nodes)


MANY = CORNERS[:36] + bytes(600_000)
GLB: dict[str, tuple[Make, str]] = {
    "a mesh of 100,000 faces 190 times": (glb(shown(190), MANY), "at most"),
    "a primitive of 100,000 faces 190 times": (glb(primitives(190), MANY), "at most"),
    "30,000 nodes": (glb(shown(30_000)), "nodes"),
    "30,000 primitives": (glb(primitives(30_000)), "primitives"),
    "60 nodes in a line": (glb(line_of_nodes(60)), "levels"),
    "15,000 nodes in a line": (glb(line_of_nodes(15_000)), "levels"),
    "nodes in a ring": (
        glb(lambda m: m.update(nodes=[{"mesh": 0, "children": [1]}, {"children": [0]}])),
        "levels",
    ),
    "a node within itself": (glb(lambda m: m["nodes"][0].update(children=[0])), "levels"),
    "a count of a trillion": (glb(lambda m: m["accessors"][0].update(count=10**12)), "elements"),
    "a count of 1e300": (glb(lambda m: m["accessors"][0].update(count=1e300)), ""),
    "a count of infinity": (glb(lambda m: m["accessors"][0].update(count=float("inf"))), ""),
    "a count of true": (glb(lambda m: m["accessors"][0].update(count=[True])), ""),
    "accessors of a number": (glb(lambda m: m.update(accessors=5)), ""),
    "accessors of numbers": (glb(lambda m: m.update(accessors=[1, 2])), ""),
    "meshes of words": (glb(lambda m: m.update(meshes=["a"])), ""),
    "an index that is not there": (glb(lambda m: m["meshes"][0]["primitives"][0].update(indices=7)), ""),
    "faces of vertices that are not there": (glb(lambda m: None, CORNERS[:36] + struct.pack("<HHH", 0, 1, 9)), ""),
    "a view outside": (glb(lambda m: m["bufferViews"][0].update(byteOffset=10**9)), ""),
    "a kind of number that is none": (glb(lambda m: m["accessors"][0].update(componentType=1)), ""),
    "no JSON": (lambda: b"glTF" + struct.pack("<II", 2, 30) + struct.pack("<I", 4) + b"JSON" + b"{{{{", ""),
    "a header alone": (lambda: b"glTF" + struct.pack("<II", 2, 12), ""),
    "17 MB of JSON": (
        lambda: b"glTF" + struct.pack("<II", 2, 20) + struct.pack("<I", 17_000_000) + b"JSON" + b" " * 17_000_000,
        "bytes of JSON",
    ),
}


@pytest.mark.parametrize("name", GLB)
def test_glb(name: str) -> None:
    make, word = GLB[name]
    Path("a.glb").write_bytes(make())
    refused(lambda: mesh_arrays(Path("a.glb")), "a.glb", word)


def test_a_mesh_may_be_shown_as_often_as_it_stays_small() -> None:
    Path("a.glb").write_bytes(glb(shown(50))())
    assert len(mesh_arrays(Path("a.glb"))[1]) == 50
