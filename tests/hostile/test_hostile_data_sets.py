"""Data sets and files of grasps: odd types, links, and what no format allows."""

import io
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from test_hostile_readers import BIG, header, merged, refused

from spgf_torch.files.digests import sealed_json
from spgf_torch.formats.acronym import read_acronym
from spgf_torch.formats.card import check_card
from spgf_torch.formats.graspgen import read_graspgen, read_gripper
from spgf_torch.formats.graspnet import read_graspnet
from spgf_torch.formats.grasps_json import read_grasps
from spgf_torch.formats.isaac import read_isaac
from spgf_torch.formats.samples import read_samples
from spgf_torch.formats.shards import read_shards


def hdf(change: Callable[[h5py.File], object]) -> Callable[[Path], object]:
    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            for name in ("scale", "mass", "density", "friction", "volume"):
                file[f"object/{name}"] = 1.0
            file["object/file"], file["gripper/type"] = np.bytes_("a.obj"), np.bytes_("hand")
            file["object/com"], file["object/inertia"], file["gripper/configuration"] = (
                np.zeros(3),
                np.eye(3),
                np.zeros(2),
            )
            file["grasps/transforms"] = np.eye(4)[None]
            for name in ("closing_linear", "closing_angular", "shaking_linear", "shaking_angular"):
                file[f"grasps/qualities/flex/object_motion_during_{name}"] = np.zeros(1)
            file["grasps/qualities/flex/object_in_gripper"] = np.ones(1, np.int64)
            change(file)

    return write


def instead(name: str, make: Callable[[h5py.File, str], object]) -> Callable[[Path], object]:
    def change(file: h5py.File) -> None:
        del file[name]
        make(file, name)

    return hdf(change)


POSES = "grasps/transforms"
ACRONYM: dict[str, tuple[Callable[[Path], object], str]] = {
    "a billion zeros in few bytes": (
        instead(POSES, lambda f, n: f.create_dataset(n, (10**7, 4, 4), "f8", chunks=(10**5, 4, 4), compression="gzip")),
        "more than",
    ),
    "a trillion zeros": (instead(POSES, lambda f, n: f.create_dataset(n, (10**10, 4, 4), "f8", chunks=True)), "more"),
    "poses of objects": (instead(POSES, lambda f, n: f.create_dataset(n, (1,), h5py.string_dtype())), "numbers"),
    "poses of references": (instead(POSES, lambda f, n: f.create_dataset(n, (1,), h5py.ref_dtype)), "numbers"),
    "poses with fields": (instead(POSES, lambda f, n: f.create_dataset(n, (1,), [("a", "f8")])), "numbers"),
    "poses that are a group": (instead(POSES, lambda f, n: f.create_group(n)), ""),
    "poses elsewhere": (
        instead(POSES, lambda f, n: f.__setitem__(n, h5py.ExternalLink("/etc/passwd", "/a"))),
        "",
    ),
    "poses through a link to nothing": (instead(POSES, lambda f, n: f.__setitem__(n, h5py.SoftLink("/a"))), ""),
    "poses of NaN": (instead(POSES, lambda f, n: f.__setitem__(n, np.full((1, 4, 4), np.nan))), "finite"),
    "a scale of two": (instead("object/scale", lambda f, n: f.__setitem__(n, np.ones(2))), ""),
    "a file of numbers": (instead("object/file", lambda f, n: f.__setitem__(n, 1.0)), ""),
    "no poses": (hdf(lambda f: f.__delitem__(POSES)), "nothing under"),
}


@pytest.mark.parametrize("name", ACRONYM)
def test_acronym(name: str) -> None:
    write, word = ACRONYM[name]
    write(Path("a.h5"))
    refused(lambda: read_acronym(Path("a.h5")), "a.h5", word)


def tar(*members: tuple[str, bytes], **about: Any) -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as archive:
        for name, content in members:
            info = tarfile.TarInfo(name)
            info.size = len(content)
            for key, value in about.items():
                setattr(info, key, value)
            archive.addfile(info, io.BytesIO(content))
    return stream.getvalue()


def packed(shape: object, descr: object = "<f4", more: bytes = b"") -> bytes:
    return tar(("a.cloud.npy", header(shape, descr) + more), ("a.json", b"{}"))


TARS: dict[str, tuple[bytes, str]] = {
    "a cloud of a trillion points": (packed((10**12, 3)), "points"),
    "a cloud with fields": (packed((3,), [("x", "<f4")], bytes(12)), "float32"),
    "a cloud of doubles": (packed((1, 3), "<f8", bytes(24)), "float32"),
    "a cloud of objects": (packed((1, 3), "|O", bytes(24)), "float32"),
    "a cloud of two columns": (packed((1, 2), "<f4", bytes(8)), "float32"),
    "a cloud of NaN": (packed((1, 3), "<f4", b"\xff" * 12), "finite"),
    "a sample without a cloud": (tar(("a.json", b"{}")), "cloud.npy"),
    "a sample without words": (tar(("a.cloud.npy", header((1, 3), "<f4") + bytes(12))), "json"),
    "words of brackets": (tar(("a.json", b"[" * 100_000), ("a.cloud.npy", b"")), ""),
    "a file twice": (tar(("a.json", b"{}"), ("a.json", b"{}")), "once"),
    "a link": (tar(("a.json", b""), type=tarfile.SYMTYPE, linkname="/etc/passwd"), "none"),
    "a hard link": (tar(("a.json", b""), type=tarfile.LNKTYPE, linkname="b"), ""),
    "a device": (tar(("a.json", b""), type=tarfile.CHRTYPE), "none"),
    "a folder": (tar(("a", b""), type=tarfile.DIRTYPE), "none"),
}


@pytest.mark.parametrize("name", TARS)
def test_samples(name: str) -> None:
    content, word = TARS[name]
    Path("a.tar").write_bytes(content)
    refused(lambda: list(read_samples(Path("a.tar"))), "a.tar", word)


DEEP = b"[" * 60 + b"]" * 60
LARGE = b" " * 70_000_000
GRASP = {"type": "NPG", "joints": {}, "closed": {}}
TEXTS: dict[str, tuple[Callable[[Path], Any], str, bytes, str]] = {
    "grasps.json of 60 levels": (read_grasps, "a.json", DEEP, "levels"),
    "grasps.json of 70 MB": (read_grasps, "a.json", LARGE, "bytes"),
    "grasps.json with a number of 5000 digits": (read_grasps, "a.json", b'{"schema": ' + b"9" * 5000 + b"}", ""),
    "graspgen of 60 levels": (read_graspgen, "a.json", DEEP, "levels"),
    "graspgen of 20 MB": (read_graspgen, "a.json", LARGE[:20_000_000], "bytes"),
    "a gripper of colons": (read_gripper, "a.yaml", b"width: 1" + b":59" * 100_000, "characters"),
    "a gripper of aliases": (read_gripper, "a.yaml", merged(9).encode(), "aliases"),
    "isaac of colons": (read_isaac, "a.yaml", b"format: 1" + b":59" * 100_000, "characters"),
    "isaac of aliases": (read_isaac, "a.yaml", merged(12).encode(), "aliases"),
    "isaac of 60 levels": (read_isaac, "a.yaml", DEEP, "levels"),
    "isaac of 20 MB": (read_isaac, "a.yaml", LARGE[:20_000_000], "bytes"),
    "isaac with keys that fall on each other": (
        read_isaac,
        "a.yaml",
        "\n".join(f"{i * BIG}: 0" for i in range(10, 20_000)).encode(),
        "a key",
    ),
    "isaac with a tag": (read_isaac, "a.yaml", b"!!python/object/apply:os.getpid []", ""),
    "graspnet of a trillion rows": (read_graspnet, "a.npy", header((10**12, 17)), ""),
    "graspnet of no row and a trillion columns": (read_graspnet, "a.npy", header((0, 10**12)), "17"),
    "graspnet of long items": (read_graspnet, "a.npy", header((1, 17), "|V1000") + bytes(17_000), "17"),
    "graspnet of fields": (read_graspnet, "a.npy", header((17,), [("a", "<f8")]) + bytes(136), "17"),
    "graspnet of objects": (read_graspnet, "a.npy", header((1, 17), "|O") + bytes(136), "Python objects"),
    "a card of 60 levels": (lambda path: check_card(path.parent), "card.json", DEEP, "levels"),
    "a card of files in a list": (
        lambda path: check_card(path.parent),
        "card.json",
        sealed_json({"schema": 1, "files": [1]}),
        "files",
    ),
    "a card without files": (lambda path: check_card(path.parent), "card.json", sealed_json({"schema": 1}), "files"),
    "a card of schema true": (
        lambda path: check_card(path.parent),
        "card.json",
        sealed_json({"schema": True, "files": {}}),
        "schema",
    ),
    "an index of shards in a list": (lambda path: read_shards(path.parent), "uuid_index.json", b"[1]", "uuids"),
    "an index of shards below 0": (lambda path: read_shards(path.parent), "uuid_index.json", b'{"a": -1}', "whole"),
    "an index of shards in fractions": (
        lambda path: read_shards(path.parent),
        "uuid_index.json",
        b'{"a": 0.5}',
        "whole",
    ),
}


@pytest.mark.parametrize("name", TEXTS)
def test_texts(name: str) -> None:
    read, file, content, word = TEXTS[name]
    Path(file).write_bytes(content)
    refused(lambda: read(Path(file).absolute()), file, word)


@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_data_set_of_links_and_pipes(kind: str) -> None:
    import os

    Path("set").mkdir()
    Path("set/card.json").write_bytes(sealed_json({"schema": 1, "files": {}}))
    if kind == "link":
        Path("set/a").symlink_to("/dev/zero")
    else:
        os.mkfifo("set/a")
    refused(lambda: check_card(Path("set")), "set/a", "")
