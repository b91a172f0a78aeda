"""Point clouds that are damaged, foreign, too large or made to hurt, given to `predict`."""

import io
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hostile import Case, Write, lines, nothing, raw, refused, table

HUGE = 10**12
POINTS = np.random.default_rng(0).random((40, 3)) * 0.1
EYE = [[0.05, 0.05, 1.0]]
INPUT = {"viewpoints": EYE}


def ply(*head: str, body: bytes = b"0 0 0\n", kind: str = "ascii") -> Write:
    return raw("\n".join(["ply", f"format {kind} 1.0", *head, "end_header", ""]).encode() + body)


def vertices(count: object, *properties: str) -> list[str]:
    return [f"element vertex {count}", *(f"property {p}" for p in properties or ("float x", "float y", "float z"))]


def pcd(body: bytes = b"0 0 0\n" * 3, **changes: object) -> Write:
    entries: dict[str, object] = {
        "VERSION": 0.7, "FIELDS": "x y z", "SIZE": "4 4 4", "TYPE": "F F F", "COUNT": "1 1 1", "WIDTH": 3, "HEIGHT": 1,
        "VIEWPOINT": "0 0 0 1 0 0 0", "POINTS": 3, "DATA": "ascii",
    }  # fmt: skip
    entries |= changes
    head = "".join(f"{key} {value}\n" for key, value in entries.items() if value is not None)
    return raw(head.encode() + body)


def npy_bytes(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def npy_header(header: str, body: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    text = header.encode() + b"\n"
    length = struct.pack("<H" if version == b"\x01\x00" else "<I", len(text))
    return b"\x93NUMPY" + version + length + text + body


def promises(shape: object, descr: object = "<f8", fortran: object = False) -> bytes:
    return npy_header(str({"descr": descr, "fortran_order": fortran, "shape": shape}), bytes(240))


def npy(array: np.ndarray) -> Write:
    return raw(npy_bytes(array))


def zipped(members: dict[str, bytes], how: int = zipfile.ZIP_DEFLATED) -> Write:
    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w", how) as archive:
            for name, content in members.items():
                archive.writestr(name, content)

    return write


def npz(**arrays: np.ndarray) -> Write:
    return zipped({f"{name}.npy": npy_bytes(np.asarray(array)) for name, array in arrays.items()})


def encrypted(path: Path) -> None:
    """The flag of encryption, set in both headers of an archive."""
    npz(points=POINTS)(path)
    content = bytearray(path.read_bytes())
    for mark, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        content[content.index(mark) + at] |= 1
    path.write_bytes(bytes(content))


def broken_stream(path: Path) -> None:
    npz(points=POINTS)(path)
    content = bytearray(path.read_bytes())
    content[60:90] = b"\xff" * 30
    path.write_bytes(bytes(content))


def pickled(path: Path) -> None:
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)


class Bomb:
    def __reduce__(self) -> Any:
        return (Path("outputs/ran").write_text, ("",))


def armed(path: Path) -> None:
    """A pickle that would leave a file."""
    np.save(path, np.array([Bomb()], dtype=object), allow_pickle=True)


def spread(scale: float) -> np.ndarray:
    return np.where(np.arange(120).reshape(40, 3) == 4, scale, POINTS)


PLY = [
    ("no header", raw(b"hello"), "header"),
    ("header without end", raw(b"ply\nformat ascii 1.0\nelement vertex 3\n"), "end_header"),
    ("header of a megabyte", raw(b"ply\n" + b"comment a\n" * 100_000 + b"end_header\n"), "end_header"),
    ("no vertices", ply(body=b""), "none"),
    ("zero vertices", ply(*vertices(0)), "none"),
    ("a trillion vertices", ply(*vertices(HUGE)), "at most"),
    ("as many as there may be, but no data", ply(*vertices(20_000_000)), "cut"),
    ("as many, binary", ply(*vertices(20_000_000), kind="binary_little_endian"), "cut"),
    ("a count of a thousand digits", ply(*vertices("9" * 1000)), "none"),
    ("a negative count", ply(*vertices(-3)), "none"),
    ("unknown format", ply(*vertices(1), kind="ternary"), "cut"),
    ("unknown type", ply(*vertices(1, "quad x", "float y", "float z")), "cut"),
    ("no z", ply(*vertices(1, "float x", "float y"), body=b"0 0\n"), "cut"),
    ("lists for coordinates", ply(*vertices(1, *(f"list uchar float {c}" for c in "xyz"))), "cut"),
    ("a trillion of something else", ply(*vertices(1), f"element dust {HUGE}", "property float a"), ""),
    ("words", ply(*vertices(1), body=b"a b c\n"), "cut"),
    ("rows too short", ply(*vertices(2), body=b"0 0 0\n1\n"), "cut"),
    ("NaN", ply(*vertices(1), body=b"nan 0 0\n"), "NaN"),
    ("normals of 0", ply(*vertices(1, *(f"float {c}" for c in ("x", "y", "z", "nx", "ny", "nz"))), body=b"0 0 0 0 0 0"),
     "length 0"),
    ("binary cut", ply(*vertices(3), kind="binary_big_endian", body=bytes(20)), "cut"),
    ("a texture elsewhere", ply("comment TextureFile ../../secret.png", *vertices(1)), ""),
    ("a name with a line break and an escape", ply("element vertex 1", "property float \x1b[31mx"), ""),
]  # fmt: skip
PCD = [
    ("no header", raw(b"\x00" * 50), "header"),
    ("no DATA", pcd(DATA=None), "DATA"),
    ("no FIELDS", pcd(FIELDS=None), "FIELDS"),
    ("fields without x", pcd(FIELDS="a y z"), "x y z"),
    ("sizes missing", pcd(SIZE="4 4"), "SIZE"),
    ("sizes no numbers", pcd(SIZE="four 4 4"), "SIZE"),
    ("unknown type", pcd(TYPE="C C C"), "TYPE"),
    ("floats of three bytes", pcd(SIZE="3 3 3"), "SIZE"),
    ("negative width", pcd(WIDTH=-3), "WIDTH"),
    ("a width of 5000 digits", pcd(WIDTH="9" * 5000), "WIDTH"),
    ("a trillion points", pcd(WIDTH=HUGE - 1, POINTS=HUGE - 1), "at most"),
    ("points that are not width times height", pcd(POINTS=4), "POINTS"),
    ("no point", pcd(WIDTH=0, POINTS=0), "none"),
    ("twenty million points of nothing", pcd(WIDTH=20_000_000, POINTS=20_000_000, DATA="binary"), "cut"),
    ("a count of a hundred million", pcd(COUNT="100000000 1 1"), "COUNT"),
    ("two values for x", pcd(COUNT="2 1 1"), "COUNT"),
    ("half a viewpoint", pcd(VIEWPOINT="0 0"), "VIEWPOINT"),
    ("a viewpoint in words", pcd(VIEWPOINT="a b c d e f g"), "VIEWPOINT"),
    ("unknown data", pcd(DATA="zip"), "DATA"),
    ("words for numbers", pcd(b"a b c\n" * 3), "numbers"),
    ("too few rows", pcd(b"0 0 0\n"), "cut"),
    ("too many values", pcd(b"0 0 0 0\n" * 3), "header"),
    ("binary cut", pcd(bytes(30), DATA="binary"), "cut"),
    ("compressed cut", pcd(struct.pack("<II", 100, 36), DATA="binary_compressed"), "cut"),
    ("a bomb of 4 GB", pcd(struct.pack("<II", 4, 2**32 - 1) + b"\xe0\xff\x00\x00", DATA="binary_compressed"), "36"),
    (
        "repeats from before the beginning",
        pcd(struct.pack("<II", 2, 36) + b"\x20\x05", DATA="binary_compressed"),
        "LZF",
    ),
    ("longer than it says", pcd(struct.pack("<II", 3, 36) + b"\x01ab", DATA="binary_compressed"), "LZF"),
    ("NaN in a list", pcd(b"nan 0 0\n" * 3), "NaN"),
    ("an image of NaN", pcd(b"nan 0 0\n" * 4, WIDTH=2, HEIGHT=2, POINTS=4), "NaN or zero"),
]
TEXT = [
    ("four columns", lines(*["1 2 3 4"] * 3), "columns"),
    ("rows of different length", lines("1 2 3", "1 2"), "rows"),
    ("words", lines("1 2 3", "1 two 3"), "rows"),
    ("no rows", lines("# nothing"), "none"),
    ("bytes", raw(bytes(range(256))), "rows"),
    ("zeros", raw(bytes(1000)), "none"),
    ("infinity", lines("1 2 3", "inf 0 0"), "infinity"),
    ("beyond float", lines("1 2 3", "1e999 0 0"), "infinity"),
    ("names without x", lines("a b c", "1 2 3"), "x, y, z"),
    ("names with an escape", lines("\x1b[31m y z", "1 2 3"), "x, y, z"),
    ("a name twice", lines("x y z z", "1 2 3 4", "1 2 3 5"), ""),
    ("one word of a megabyte", raw("9" * 1_000_000 + " 0 0\n"), ""),
    ("a million columns", raw("1 " * 1_000_000), "columns"),
    ("quotes that do not close", lines('"1,2,3', "1,2,3"), "rows"),
]
NPY = [
    ("empty file", raw(b""), "empty"),
    ("no header", raw(b"hello"), "damaged"),
    ("half a header", raw(npy_bytes(POINTS)[:40]), "damaged"),
    ("data cut", raw(npy_bytes(POINTS)[:-8]), "damaged"),
    ("a trillion points", raw(promises((HUGE, 3))), "damaged"),
    ("a shape beyond any machine", raw(promises((10**30, 3))), "damaged"),
    ("a negative shape", raw(promises((-5, 3))), ""),
    ("a shape of words", raw(promises("abc")), "damaged"),
    ("a shape of a hundred dimensions", raw(promises((1,) * 100)), "damaged"),
    ("a header that is code", raw(npy_header("__import__('os').system('touch outputs/ran')")), "damaged"),
    ("a header that never closes", raw(npy_header("{'descr': (((((")), "damaged"),
    ("a header of brackets", raw(npy_header("(" * 9000)), "damaged"),
    ("a header of a megabyte", raw(npy_header(" " * 2**20, version=b"\x02\x00")), "damaged"),
    ("version 9", raw(npy_header("{}", version=b"\x09\x00")), "damaged"),
    ("a type that is none", raw(promises((10, 3), "<q9")), "damaged"),
    ("records", raw(promises((10,), [("x", "<f8"), ("y", "<f8"), ("z", "<f8")])), "numbers"),
    ("objects", pickled, "Python objects"),
    ("a pickle that would run", armed, "Python objects"),
    ("complex numbers", npy(POINTS.astype(complex)), "numbers"),
    ("text", npy(np.array([["a", "b", "c"]])), "numbers"),
    ("dates", npy(np.zeros((5, 3), "M8[s]")), "numbers"),
    ("one number", npy(np.float64(3)), "shape"),
    ("a row", npy(POINTS[0]), "shape"),
    ("two columns", npy(POINTS[:, :2]), "shape"),
    ("five dimensions", npy(np.zeros((1, 1, 1, 1, 3))), "shape"),
    ("no point", npy(np.zeros((0, 3))), "none"),
    ("NaN", npy(spread(np.nan)), "NaN"),
    ("infinite normals", npy(np.hstack([POINTS, spread(np.inf)])), "infinity"),
    ("numbers near the largest", npy(spread(1e300)), "unit"),
    ("all in one place", npy(np.zeros((40, 3))), "extent"),
    ("an unlikely extent", npy(POINTS * 1e6), "extent"),
    ("points far from each other", npy(POINTS * 50), ""),
]
NPZ = [
    ("no archive", raw(b"hello"), "damaged"),
    ("half an archive", raw(b"PK\x03\x04 half"), "damaged"),
    ("an array instead", npy(POINTS), "damaged"),
    ("nothing in it", zipped({}), "points"),
    ("other names", npz(xyz=POINTS), "xyz"),
    ("not arrays", zipped({"points.npy": b"hello"}), "damaged"),
    ("a bomb of zeros", zipped({"points.npy": promises((HUGE, 3)) + bytes(10_000_000)}), "at most"),
    ("a bomb beside the points", zipped({"points.npy": promises((30, 1)), "z.npy": bytes(20_000_000)}), ""),
    ("fewer bytes than promised", zipped({"points.npy": promises((1_000_000, 3))}), "damaged"),
    ("objects in it", zipped({"points.npy": promises((10, 3), "|O")}), "plain numbers"),
    ("a name that climbs", zipped({"../../points.npy": npy_bytes(POINTS[:, :2])}), "shape"),
    ("encrypted", encrypted, "damaged"),
    ("a broken stream", broken_stream, "damaged"),
    ("normals of another shape", npz(points=POINTS, normals=POINTS[:5]), "normals"),
    ("viewpoints of words", npz(points=POINTS, viewpoints=np.array(["a"])), "numbers"),
    ("viewpoints infinite", npz(points=POINTS, viewpoints=np.full((1, 3), np.inf)), "viewpoints"),
    ("viewpoints in another unit", npz(points=POINTS, viewpoints=np.full((1, 3), 1e6)), "viewpoints"),
]


def cases(suffix: str, listed: list[tuple[str, Write, str]]) -> list[Case]:
    file = f"cloud{suffix}"
    settings = {"input": file} if suffix == ".npz" else {"input": file, **INPUT}
    return [
        Case(f"{suffix[1:]}: {name}", settings, write, (word,) if word == "viewpoints" else (file, word))
        for name, write, word in listed
    ]


ALL = [
    *cases(".ply", PLY),
    *cases(".pcd", PCD),
    *cases(".xyz", TEXT),
    *cases(".npy", NPY),
    *cases(".npz", NPZ),
    Case("no file", {"input": "cloud.ply"}, nothing, ("cloud.ply", "nothing there")),
    Case("no input", {"input": None}, nothing, ("input",)),
    Case("a name too long", {"input": "c" * 5000 + ".ply"}, nothing, ("too long",)),
    Case("a name with a line break", {"input": "cl\noud.ply"}, nothing, ("nothing there",)),
    Case("a name with an escape", {"input": "\x1b]0;cloud.ply"}, nothing, ("x1b",)),
    Case("somebody's home", {"input": "~nobody-of-that-name/cloud.ply"}, nothing, ("nobody",)),
    Case("a folder", {"input": "."}, nothing, ("folder",)),
    Case("an unknown suffix", {"input": "cloud.las"}, raw(b"LASF"), ("las",)),
    Case("no suffix", {"input": "cloud"}, raw(b"1 2 3"), ("suffix",)),
    Case("viewpoints in words", {"input": "cloud.npy", "viewpoints": "abc"}, npy(POINTS), ("viewpoints",)),
    Case("viewpoints beyond float", {"input": "a.npy", "viewpoints": [[10**400, 0, 0]]}, npy(POINTS), ("viewpoints",)),
    Case("neither normals nor viewpoints", {"input": "cloud.npy"}, npy(POINTS), ("viewpoints",)),
    Case("crop box upside down", {"input": "cloud.npy", "crop_low": [1, 1, 1], "crop_high": [0, 0, 0], **INPUT},
         npy(POINTS), ("crop_low",)),
    Case("a table in words", {"input": "cloud.npy", "table": "oak", **INPUT}, npy(POINTS), ("table",)),
    Case("a table of zeros", {"input": "cloud.npy", "table": [0, 0, 0, 0], **INPUT}, npy(POINTS), ("table",)),
]  # fmt: skip


@table(ALL)
def test_one_line(case: Case, model_known: None, capsys: pytest.CaptureFixture) -> None:
    if case.write is not nothing:
        case.write(Path(case.changes["input"]))
    refused("predict", case.changes, (*case.words, "expected", "got"), capsys)
