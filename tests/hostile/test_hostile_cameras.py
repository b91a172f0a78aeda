"""Depth images, intrinsics, poses and masks that are damaged, foreign, too large or made to hurt."""

import io
import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hostile import Case, Write, as_json, lines, nothing, raw, refused, table
from PIL import Image

DEPTH = np.full((40, 50), 700, np.uint16)
K = [[50.0, 0, 25], [0, 50.0, 20], [0, 0, 1]]
T = np.eye(4)


def image(pixels: np.ndarray, kind: str = "PNG") -> Write:
    return raw(image_bytes(pixels, kind))


def image_bytes(pixels: np.ndarray, kind: str = "PNG") -> bytes:
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, kind)
    return stream.getvalue()


def chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(width: int, height: int, data: bytes = b"", extra: bytes = b"", bits: int = 16) -> Write:
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0))
    return raw(b"\x89PNG\r\n\x1a\n" + head + extra + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b""))


def npy(array: Any) -> Write:
    return lambda path: np.save(path, array)


def yaml_k(matrix: str) -> Write:
    return raw(f"image_width: 50\nimage_height: 40\ncamera_matrix: {matrix}\n")


def poses(*changes: tuple[int, int, float]) -> list[list[float]]:
    changed = T.copy()
    for row, column, value in changes:
        changed[row, column] = value
    return changed.tolist()


EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 50 40\n%%EndComments\n(outputs/ran) (w) file closefile\nshowpage\n"
LAUGHS = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"{y}: &{y} [{', '.join([f'*{x}'] * 9)}]\n" for x, y in zip("abcdefgh", "bcdefghi", strict=True)
)

IMAGES = [
    ("d.png", "empty", raw(b""), "empty"),
    ("d.png", "bytes", raw(bytes(range(256))), "damaged"),
    ("d.png", "cut", raw(image_bytes(DEPTH)[:60]), "damaged"),
    ("d.png", "eight bits", image(DEPTH.astype(np.uint8)), "16 bits"),
    ("d.png", "colours", image(np.zeros((40, 50, 3), np.uint8)), "channels"),
    ("d.png", "nothing measured", image(0 * DEPTH), "none"),
    ("d.png", "all too far", image(np.full_like(DEPTH, 65535)), "none"),
    ("d.png", "of two billion pixels", png(2**15, 2**16), "damaged"),
    ("d.png", "of a hundred million pixels", png(10_000, 10_000), ""),
    ("d.png", "of thirty million pixels", png(6000, 5000, bytes(1000)), "at most"),
    ("d.png", "of no pixel", png(0, 0), "damaged"),
    ("d.png", "with fewer data than pixels", png(2000, 2000, bytes(100)), "damaged"),
    ("d.png", "with text of 200 MB",
     lambda path: png(50, 40, extra=chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(200_000_000), 9)))(path), "damaged"),
    ("d.png", "that is PostScript", raw(EPS), "damaged"),
    ("d.png", "that is a JPEG", image(DEPTH.astype(np.uint8), "JPEG"), "damaged"),
    ("d.npy", "of numbers in a row", npy(np.ones(40)), "(H, W)"),
    ("d.npy", "of text", npy(np.array([["a"]])), "numbers"),
    ("d.npy", "of a trillion pixels", raw(b"\x93NUMPY\x01\x00v\x00" + str({"descr": "<f4", "fortran_order": False,
     "shape": (10**6, 10**6)}).ljust(117).encode() + b"\n"), "damaged"),
    ("d.npy", "of NaN", npy(np.full((40, 50), np.nan)), "none"),
    ("d.npy", "in millimetres", npy(DEPTH.astype(float)), "unit=mm would fit"),
    ("d.npy", "of another size than K", npy(np.full((400, 500), 0.7)), "K"),
    ("d.exr", "of another kind", raw(b"v/1\x01 and more"), "exr"),
]  # fmt: skip
INTRINSICS = [
    ("K.txt", "empty", raw(b""), "empty"),
    ("K.txt", "words", lines("fx 0 cx"), "numbers"),
    ("K.txt", "eight numbers", lines("1 2 3", "4 5 6", "7 8"), "K.txt"),
    ("K.txt", "rows of different length", lines("1 2 3 4", "5 6 7", "8 9"), "matrix"),
    ("K.txt", "bytes", raw(bytes(range(128, 256))), "numbers"),
    ("K.txt", "20 MB", raw(b"1 " * 10_000_000), "bytes"),
    ("K.txt", "NaN", lines("nan 0 25", "0 50 20", "0 0 1"), "finite"),
    ("K.txt", "a focal length below 0", lines("-50 0 25", "0 50 20", "0 0 1"), "focal"),
    ("K.txt", "a last row of another kind", lines("50 0 25", "0 50 20", "0 1 1"), "0 0 1"),
    ("K.json", "no JSON", raw(b"{K: 1"), "K.json"),
    ("K.json", "a number", as_json(5), "shape"),
    ("K.json", "null", as_json(None), "K.json"),
    ("K.json", "other keys", as_json({"matrix": K}), "camera_matrix"),
    ("K.json", "a matrix in words", as_json({"K": "calib"}), "matrix"),
    ("K.json", "a matrix of matrices", as_json({"K": [K, K]}), "K.json"),
    ("K.json", "three matrices", as_json({"K": [K, K, K]}), "K.json"),
    ("K.json", "a number beyond float", raw(b'{"K": [' + b"9" * 400 + b", 0, 0, 0, 1, 0, 0, 0, 1]}"), "matrix"),
    ("K.json", "a number of 5000 digits", raw(b'{"K": [' + b"9" * 5000 + b", 0, 0, 0, 1, 0, 0, 0, 1]}"), "K.json"),
    ("K.json", "brackets without end", raw(b"[" * 200_000), "K.json"),
    ("K.json", "a hundred levels", raw(b"[" * 100 + b"]" * 100), "levels"),
    ("K.json", "half of fx, fy, cx, cy", as_json({"fx": 1, "fy": 2}), "fx"),
    ("K.json", "fx in words", as_json({"fx": "a", "fy": 2, "cx": 1, "cy": 1}), "matrix"),
    ("K.json", "of an image of another size", as_json({"K": K, "width": 640, "height": 480}), "640"),
    ("K.yaml", "no YAML", raw(b"camera_matrix: ["), "K.yaml"),
    ("K.yaml", "a matrix without data", yaml_k("{rows: 3, cols: 3}"), "K.yaml"),
    ("K.yaml", "dates", yaml_k("{data: [2001-01-01]}"), "matrix"),
    ("K.yaml", "an impossible date", yaml_k("{data: [2001-99-99]}"), "K.yaml"),
    ("K.yaml", "a tag that makes an object", yaml_k("!!python/object/apply:os.system ['touch outputs/ran']"), "K.yaml"),
    ("K.yaml", "an unknown tag", yaml_k("!camera [1]"), "K.yaml"),
    ("K.yaml", "an empty number", yaml_k("!!int ''"), "K.yaml"),
    ("K.yaml", "a billion laughs", raw(LAUGHS + "K: *i\n"), "aliases"),
    ("K.yaml", "two documents", raw(b"--- 1\n--- 2\n"), "K.yaml"),
    ("K.yaml", "a set", yaml_k("!!set {a, b}"), "matrix"),
    ("K.npy", "another shape", npy(np.eye(4)), "shape"),
    ("K.npy", "objects", lambda path: np.save(path, np.array([{}], dtype=object), allow_pickle=True), "np.savez"),
]
POSES = [
    ("T.json", "a number", as_json(5), "shape"),
    ("T.json", "a row", as_json([1, 2, 3, 4]), "shape"),
    ("T.json", "two by four", as_json(T[:2].tolist()), "shape"),
    ("T.json", "nothing", as_json([]), "shape"),
    ("T.json", "another key", as_json({"pose": T.tolist()}), "T_input_camera"),
    ("T.json", "two for one image", as_json([T.tolist(), T.tolist()]), "one a depth image"),
    ("T.json", "mirrored", as_json(poses((0, 0, -1.0))), "rotation"),
    ("T.json", "scaled", as_json(poses((0, 0, 2.0))), "rotation"),
    ("T.json", "NaN", raw(json.dumps(poses((0, 3, float("nan")))).encode()), "rotation"),
    ("T.json", "another last row", as_json(poses((3, 0, 1.0))), "0 0 0 1"),
    ("T.json", "in millimetres", as_json(poses((0, 3, 700.0))), "mm"),
    ("T.txt", "words", lines("a b c d"), "numbers"),
]
MASKS = [
    ("m.png", "empty", raw(b""), "empty"),
    ("m.png", "nothing kept", image(np.zeros((40, 50), np.uint8)), "above 0"),
    ("m.png", "of another size", image(np.ones((4, 5), np.uint8)), "pixels"),
    ("m.png", "of thirty million pixels", png(6000, 5000, bits=8), "at most"),
    ("m.png", "that is PostScript", raw(EPS), "damaged"),
    ("m.npy", "one number", npy(np.float64(1)), "shape"),
    ("m.npy", "five dimensions", npy(np.ones((1, 1, 1, 1, 1))), "shape"),
    ("m.npy", "text", npy(np.array(["a"])), "numbers"),
    ("m.npy", "no pixel", npy(np.ones((0, 5))), "shape"),
]
GOOD = {"input": "good.npy", "intrinsics": "good.txt"}
CASES = [
    Case(f"image {f}: {n}", {"input": f, "intrinsics": "good.txt"}, w, (word,) if word == "K" else (f, word))
    for f, n, w, word in IMAGES
]
CASES += [Case(f"{f}: {n}", {**GOOD, "intrinsics": f}, w, (word,)) for f, n, w, word in INTRINSICS]
CASES += [Case(f"{f}: {n}", {**GOOD, "poses": f}, w, ("T" if word == "" else word,)) for f, n, w, word in POSES]
CASES += [Case(f"mask {f}: {n}", {**GOOD, "mask": f}, w, (f, word)) for f, n, w, word in MASKS]
CASES += [
    Case("an image without intrinsics", {"input": GOOD["input"]}, nothing, ("intrinsics",)),
    Case("intrinsics that are not there", {**GOOD, "intrinsics": "none.txt"}, nothing, ("none.txt",)),
    Case("intrinsics that are a number", {**GOOD, "intrinsics": 5}, nothing, ("intrinsics",)),
    Case("two intrinsics", {**GOOD, "intrinsics": ["good.txt", "good.txt"]}, nothing, ("intrinsics",)),
    Case("two images without poses", {**GOOD, "input": ["good.npy", "good.npy"]}, nothing, ("poses",)),
    Case("two masks", {**GOOD, "mask": ["good.npy", "good.npy"]}, nothing, ("mask",)),
    Case("viewpoints of an image", {**GOOD, "viewpoints": [[0, 0, 0]]}, nothing, ("viewpoints",)),
]


@table(CASES)
def test_one_line(case: Case, model_known: None, capsys: pytest.CaptureFixture) -> None:
    np.save("good.npy", np.full((40, 50), 0.7))
    lines(*(" ".join(map(str, row)) for row in K))(Path("good.txt"))
    for key in ("input", "intrinsics", "poses", "mask"):
        file = case.changes.get(key)
        if isinstance(file, str) and not Path(file).exists() and case.write is not nothing:
            case.write(Path(file))
    refused("predict", case.changes, (*case.words, "expected", "got"), capsys)
