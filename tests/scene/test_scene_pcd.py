"""PCD files written from the specification, in all three encodings."""

import struct
from pathlib import Path

import numpy as np
import pytest

from spgf_torch.errors import InputError
from spgf_torch.scene.files import read_cloud
from spgf_torch.scene.pcd import lzf_decompress

LIMIT = 1000
ROW = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("pad", "<u1", (4,)), ("nx", "<f8"), ("ny", "<f8"), ("nz", "<f8")]
)
ROWS = np.zeros(6, ROW)
ROWS["x"], ROWS["y"], ROWS["z"] = np.arange(6) / 8, 1.5, [0.25, 0.5, 0.75, -1, -2, -3]
ROWS["nx"], ROWS["nz"], ROWS["pad"] = 0.6, 0.8, 99
HEAD = {
    "VERSION": "0.7",
    "FIELDS": "x y z _ normal_x normal_y normal_z",
    "SIZE": "4 4 4 1 8 8 8",
    "TYPE": "F F F U F F F",
    "COUNT": "1 1 1 4 1 1 1",
    "WIDTH": "6",
    "HEIGHT": "1",
    "VIEWPOINT": "0.5 0 2 1 0 0 0",
    "POINTS": "6",
}


def lzf(data: bytes) -> bytes:
    """LZF by the format's description: repetitions of 3 bytes or more, found by trying every distance up to 64."""
    out, literals, i = bytearray(), bytearray(), 0

    def flush() -> None:
        for start in range(0, len(literals), 32):
            piece = literals[start : start + 32]
            out.extend(bytes([len(piece) - 1]) + piece)
        literals.clear()

    while i < len(data):
        runs = []
        for distance in range(1, min(i, 64) + 1):
            length = 0
            while length < 264 and i + length < len(data) and data[i + length] == data[i + length - distance]:
                length += 1
            runs.append((length, distance))
        length, distance = max(runs, default=(0, 0))
        if length < 3:
            literals.append(data[i])
            i += 1
            continue
        flush()
        code, far = length - 2, distance - 1
        out.extend([code << 5 | far >> 8, far & 255] if code < 7 else [7 << 5 | far >> 8, code - 7, far & 255])
        i += length
    flush()
    return bytes(out)


def pcd(data: str, rows: np.ndarray = ROWS, **changes: str | None) -> bytes:
    """A PCD file; a change to None leaves the header's line out."""
    head = {**HEAD, "WIDTH": str(len(rows)), "POINTS": str(len(rows)), **changes, "DATA": data}
    text = "# .PCD v0.7\n" + "".join(f"{key} {value}\n" for key, value in head.items() if value is not None)
    if data == "ascii":
        lines = (" ".join(f"{v:.9g}" for name in ROW.names for v in np.atleast_1d(row[name])) for row in rows)
        return (text + "\n".join(lines) + "\n").encode()
    if data == "binary":
        return text.encode() + rows.tobytes()
    fields = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in ROW.names)
    packed = lzf(fields)
    return text.encode() + struct.pack("<II", len(packed), len(fields)) + packed


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_points_normals_and_viewpoint_survive(data: str, tmp_path: Path) -> None:
    (tmp_path / "a.pcd").write_bytes(pcd(data))
    cloud = read_cloud(tmp_path / "a.pcd", LIMIT)
    np.testing.assert_array_equal(cloud.points, np.stack([ROWS["x"], ROWS["y"], ROWS["z"]], axis=1))
    np.testing.assert_allclose(cloud.normals, np.tile([0.6, 0, 0.8], (6, 1)))
    np.testing.assert_array_equal(cloud.viewpoints, [[0.5, 0, 2]])


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_pixels_without_a_measurement_are_dropped(data: str, tmp_path: Path) -> None:
    rows = ROWS.copy()
    rows["y"][[1, 4]] = np.nan
    (tmp_path / "a.pcd").write_bytes(pcd(data, rows, WIDTH="2", HEIGHT="3"))
    image = read_cloud(tmp_path / "a.pcd", LIMIT)
    np.testing.assert_array_equal(image.points[:, 0], np.array([0, 2, 3, 5]) / 8)
    np.testing.assert_array_equal(image.pixels, [[0, 0], [1, 0], [1, 1], [2, 1]])
    (tmp_path / "a.pcd").write_bytes(pcd(data, rows))
    cloud = read_cloud(tmp_path / "a.pcd", LIMIT)
    np.testing.assert_array_equal(cloud.points, image.points)
    assert cloud.pixels is None
    assert cloud.notes == ("2 of 6 points without a reading (NaN, infinite or 0 0 0) left out",)


def test_points_alone_and_old_headers(tmp_path: Path) -> None:
    """No COUNT, no VIEWPOINT, no POINTS; COLUMNS was the name of FIELDS before 0.5. The camera is not known."""
    head = "COLUMNS rgb z y x\nSIZE 4 8 4 2\nTYPE U F F I\nWIDTH 2\nHEIGHT 1\nDATA ascii\n"
    (tmp_path / "a.pcd").write_text(head + "9 1.5 2 3\n9 2.5 3 4\n")
    cloud = read_cloud(tmp_path / "a.pcd", LIMIT)
    np.testing.assert_array_equal(cloud.points, [[3, 2, 1.5], [4, 3, 2.5]])
    assert cloud.viewpoints is None
    assert cloud.normals is None


@pytest.mark.parametrize("words", ["0 0 0 1 0 0 0", "0.0 -0 0e0 1.0 0 0 0", "-0 0 0 -1 0 0 0", "0 0 0 0 0 0 0"])
@pytest.mark.parametrize("fields", [HEAD["FIELDS"], "x y z _ a b c"], ids=["normals", "points alone"])
def test_the_identity_viewpoint_says_nothing(words: str, fields: str, tmp_path: Path) -> None:
    (tmp_path / "a.pcd").write_bytes(pcd("binary", VIEWPOINT=words, FIELDS=fields))
    assert read_cloud(tmp_path / "a.pcd", LIMIT).viewpoints is None
    (tmp_path / "a.pcd").write_bytes(pcd("binary", VIEWPOINT="0 0 0 0 1 0 0", FIELDS=fields))
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.pcd", LIMIT).viewpoints, [[0, 0, 0]])


@pytest.mark.parametrize("fields", ["X Y Z _ Normal_X Normal_Y Normal_Z", "x y z _ nx ny nz"])
def test_names_of_fields_as_programs_write_them(fields: str, tmp_path: Path) -> None:
    content = pcd("ascii", FIELDS=fields, TYPE="f f f u f f f").replace(b"DATA ascii", b"data ASCII")
    (tmp_path / "a.pcd").write_bytes(content)
    np.testing.assert_allclose(read_cloud(tmp_path / "a.pcd", LIMIT).normals, np.tile([0.6, 0, 0.8], (6, 1)))


def test_nan_as_windows_writes_it(tmp_path: Path) -> None:
    for word in (b"1.#QNAN", b"-1.#IND", b"-nan(ind)", b"nan(0x8)", b"-nan", b"1.#INF"):
        (tmp_path / "a.pcd").write_bytes(pcd("ascii").replace(b"1.5", word, 2))
        assert len(read_cloud(tmp_path / "a.pcd", LIMIT)) == 4


def test_lzf_by_hand() -> None:
    """'abc' literally (control 3 - 1), then 6 bytes from 3 back: (6 - 2) << 5 = 0x80, 3 - 1 = 2, running into itself.
    A run of 264 + 1 'a': one literally, then the longest repetition, 7 << 5, 264 - 2 - 7 = 255, distance 1 - 1."""
    assert lzf_decompress(b"\x02abc\x80\x02", 9) == b"abcabcabc"
    assert lzf_decompress(b"\x00a\xe0\xff\x00", 265) == b"a" * 265
    for packed, size in ((b"\x02ab", 3), (b"\x00a\x80", 5), (b"\x80\x02", 6), (b"\x00a", 2)):
        with pytest.raises(ValueError):
            lzf_decompress(packed, size)


def test_lzf_round_trip(rng: np.random.Generator) -> None:
    for high in (2, 4, 256):
        data = rng.integers(0, high, 3000, dtype=np.uint8).tobytes() + bytes(700)
        assert lzf_decompress(lzf(data), len(data)) == data


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 0.97])
def test_a_file_cut_in_half(data: str, share: float, tmp_path: Path) -> None:
    whole = pcd(data)
    (tmp_path / "a.pcd").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"a\.pcd: expected") as caught:
        read_cloud(tmp_path / "a.pcd", LIMIT)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (pcd("ascii", FIELDS="x y w _ normal_x normal_y normal_z"), "FIELDS: expected x y z, got x y w _ normal_x"),
        (pcd("ascii", FIELDS=None), "expected a PCD header with FIELDS"),
        (pcd("ascii", SIZE=None), "SIZE: expected 7 values in the PCD header, got 0"),
        (pcd("ascii", TYPE="F F F"), "TYPE: expected 7 values in the PCD header, got 3"),
        (pcd("ascii", TYPE="F F X U F F F"), "got z X4"),
        (pcd("ascii", SIZE="2 4 4 1 8 8 8"), "got x F2"),
        (pcd("ascii", COUNT="2 1 1 4 1 1 1"), "COUNT of x: expected 1, got 2"),
        (pcd("ascii", WIDTH="-6"), "WIDTH: expected whole numbers, got -6"),
        (pcd("ascii", HEIGHT=None), "HEIGHT: expected 1 values"),
        (pcd("ascii", POINTS="7"), "expected POINTS = WIDTH x HEIGHT = 6, got 7"),
        (pcd("ascii", VIEWPOINT="0 0 0"), "VIEWPOINT: expected 7 values"),
        (pcd("ascii", VIEWPOINT="0 0 0 1 0 0 x"), "VIEWPOINT: expected seven numbers"),
        (pcd("ascii", VIEWPOINT="0 0 nan 1 0 0 0"), "VIEWPOINT: expected seven numbers, got 0 0 nan"),
        (
            pcd("ascii").replace(b"DATA ascii", b"DATA zip"),
            "DATA: expected ascii, binary or binary_compressed, got zip",
        ),
        (pcd("ascii").replace(b"1.5", b"one"), "expected numbers after DATA ascii, got other words"),
        (pcd("ascii", ROWS[:0]), "expected points, got none"),
        (pcd("ascii", np.zeros(LIMIT + 1, ROW)), r"at most 1000 points \(max_points\), got 1001; thin"),
        (pcd("ascii", np.zeros(2, ROW)), "expected points, got none: all 2 are NaN, infinite or 0 0 0"),
        (pcd("ascii", FIELDS="x y z _ x normal_y normal_z"), "COUNT of x: expected 1, got 2 fields of this name"),
        (b"not a header", "expected a PCD header that ends with DATA, got none"),
        (pcd("binary_compressed")[:-8] + b"\xff" * 8, "expected LZF compressed data, got damaged ones"),
    ],
)
def test_bad_input_is_named(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.pcd").write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read_cloud(tmp_path / "a.pcd", LIMIT)
    assert str(caught.value).startswith(str(tmp_path / "a.pcd"))
    assert "\n" not in str(caught.value)
