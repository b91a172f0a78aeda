"""The cache: what it gives back, what it tells apart, and that nothing wrong with its folder changes a result."""

import errno
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from spgf_torch import cache as module
from spgf_torch.cache import Cache, code_fingerprint, fingerprint, trim
from spgf_torch.terminal import Ended


class Maker:
    """Makes the same tensors every time, and counts how often."""

    def __init__(self, value: float = 1.0) -> None:
        self.value, self.calls = value, 0

    def __call__(self) -> dict[str, Tensor]:
        self.calls += 1
        return {
            "pairs": torch.arange(6, dtype=torch.int32).view(2, 3),
            "rings": torch.full((4, 2), self.value),
            "hit": torch.tensor([True, False]),
            "nothing": torch.zeros(0, 3),
            "one": torch.tensor(7),
        }


def same(first: dict[str, Tensor], second: dict[str, Tensor]) -> bool:
    return first.keys() == second.keys() and all(
        first[name].dtype == second[name].dtype and torch.equal(first[name], second[name]) for name in first
    )


def entry(folder: Path) -> Path:
    (path,) = folder.glob("*.safetensors")
    return path


def test_an_entry_is_made_once_and_read_by_others(tmp_path: Path) -> None:
    make = Maker()
    first = Cache(tmp_path / "new/cache").tensors("kind", "key", make)
    other = Cache(tmp_path / "new/cache")
    assert other.holds("kind", "key") and not other.holds("kind", "other")
    second = other.tensors("kind", "key", make)
    assert make.calls == 1 and same(first, make()) and same(second, make())
    assert [path.name for path in (tmp_path / "new/cache").iterdir()] == ["kind-key.safetensors"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, partial(Ended, signal.SIGTERM)])
def test_who_ends_the_work_learns_where_it_goes_on_from(error: Callable[[], BaseException], tmp_path: Path) -> None:
    for folder, notes in ((tmp_path, 1), (tmp_path / "nothing", 0), (None, 0)):
        with pytest.raises(KeyboardInterrupt) as ended, Cache(folder).going_on():
            raise error()
        told = getattr(ended.value, "__notes__", [])
        assert len(told) == notes and all(f"kept in {tmp_path}: the same call goes on" in line for line in told)
    with pytest.raises(ValueError, match="other") as other, Cache(tmp_path).going_on():
        raise ValueError("other")
    assert not hasattr(other.value, "__notes__")


def test_other_keys_and_kinds_are_other_entries(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    values = {
        name: cache.tensors(*name, Maker(float(i)))["rings"][0, 0].item()
        for i, name in enumerate([("a", "x"), ("a", "y"), ("b", "x")])
    }
    assert list(values.values()) == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("off", [None, "off", "null", "False", ""])
def test_a_cache_that_is_off_keeps_nothing(off: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    make, cache = Maker(), Cache.open(off, 8)
    assert same(cache.tensors("kind", "key", make), cache.tensors("kind", "key", make))
    assert make.calls == 2 and not cache.holds("kind", "key") and not list(tmp_path.iterdir())


@pytest.mark.parametrize("damage", ["flipped", "cut", "empty", "foreign", "renamed"])
def test_a_damaged_entry_is_made_again(damage: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cache, make = Cache(tmp_path), Maker()
    expected = cache.tensors("kind", "key", make)
    path = entry(tmp_path)
    content = bytearray(path.read_bytes())
    content[-3] ^= 1
    if damage == "renamed":  # another entry under this name
        Cache(tmp_path / "other").tensors("kind", "other", Maker(2.0))
        content = bytearray(entry(tmp_path / "other").read_bytes())
    path.write_bytes({"cut": content[: len(content) // 2], "empty": b"", "foreign": b"x" * 500}.get(damage, content))
    capsys.readouterr()
    assert same(cache.tensors("kind", "key", make), expected) and make.calls == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1 and str(path) in told[0] and "damaged" in told[0]
    assert same(cache.tensors("kind", "key", make), expected) and make.calls == 2  # replaced


def test_a_folder_that_cannot_be_written_costs_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("not a folder")
    cache, make = Cache(tmp_path / "file/cache"), Maker()
    for key in ("a", "b", "a"):
        assert same(cache.tensors("kind", key, make), make())
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1 and "file" in told[0]


def test_a_full_disk_costs_one_line_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    cache = Cache(tmp_path)
    for key in ("a", "b"):
        assert same(cache.tensors("kind", key, Maker()), Maker()())
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1 and "No space left" in told[0] and "going on without" in told[0]
    assert not list(tmp_path.iterdir())


def test_the_least_recently_used_entries_go_first(tmp_path: Path) -> None:
    """Three entries of one size s, last used in the order b, c, a: with room for two and a half, b goes."""
    cache = Cache(tmp_path)
    for age, key in enumerate("abc"):
        cache.tensors("kind", key, Maker())
        os.utime(tmp_path / f"kind-{key}.safetensors", (1000 + age, 1000 + age))
    cache.tensors("kind", "a", Maker())  # read: used just now
    size = (tmp_path / "kind-a.safetensors").stat().st_size
    assert trim(tmp_path, 3 * size) == 3 * size
    assert trim(tmp_path, int(2.5 * size)) == 2 * size
    assert sorted(path.stem for path in tmp_path.iterdir()) == ["kind-a", "kind-c"]


def test_a_cache_stays_within_its_limit(tmp_path: Path) -> None:
    def large() -> dict[str, Tensor]:
        return {"values": torch.zeros(25_000)}  # 100 kB

    cache = Cache(tmp_path, gigabytes=350e-6)
    for key in range(10):
        cache.tensors("kind", str(key), large)
        os.utime(tmp_path / f"kind-{key}.safetensors", (1000 + key, 1000 + key))
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 350e3
    assert cache.holds("kind", "9") and not cache.holds("kind", "0")


def test_parts_of_processes_that_died_are_removed(tmp_path: Path) -> None:
    for name, age in (("0" * 32, 2 * module.ABANDONED), ("1" * 32, 0), ("somebody's", 2 * module.ABANDONED)):
        part = tmp_path / f".{name}.part"
        part.write_text("half an entry")
        os.utime(part, (time.time() - age, time.time() - age))
    Cache(tmp_path).tensors("kind", "key", Maker())
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == [f".{'1' * 32}.part", ".somebody's.part", "kind-key.safetensors"]


# Writes, reads and evicts the same keys again and again; ends with status 1 on any wrong value.
BUSY = """
import sys, torch
from pathlib import Path
from spgf_torch.cache import Cache

cache = Cache(Path(sys.argv[1]), gigabytes=5 * 40e-6)
for turn in range(200):
    key = turn % 8
    found = cache.tensors("kind", str(key), lambda: {"values": torch.full((10_000,), float(key))})["values"]
    assert found.shape == (10_000,) and (found == key).all()
"""


def test_two_processes_share_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """There is room for five of eight entries, so both write, read and remove all the time."""
    command = [sys.executable, "-c", BUSY, str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), "OMP_NUM_THREADS": "1"}
    other = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
    monkeypatch.setattr(sys, "argv", ["busy", str(tmp_path)])
    while other.poll() is None:
        exec(compile(BUSY, "busy", "exec"), {})
        time.sleep(0.01)
    assert (other.communicate()[1], other.returncode) == ("", 0)
    assert all(path.suffix == ".safetensors" for path in tmp_path.iterdir())


@dataclass
class Room:
    radius: float
    name: str = "a"


@dataclass
class Hall:
    radius: float
    name: str = "a"


def test_a_fingerprint_depends_on_content_alone() -> None:
    first = fingerprint({"a": 1, "b": [2.0, None]}, torch.arange(3), Room(0.03))
    assert first == fingerprint({"b": (2.0, None), "a": 1}, np.arange(3), Room(0.03))
    strided = np.arange(12.0).reshape(3, 4)[:, ::2]
    assert fingerprint(strided) == fingerprint(strided.copy())


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (("ab", "c"), ("a", "bc")),
        ((["a"], "b"), (["a", "b"],)),
        ((1,), (1.0,)),
        ((1,), (True,)),
        (("1",), (1,)),
        ((None,), ("None",)),
        ((b"a",), ("a",)),
        (({"a": "b"},), ({"b": "a"},)),
        ((0.1 + 0.2,), (0.3,)),
        ((torch.zeros(2, 3),), (torch.zeros(3, 2),)),
        ((torch.zeros(2),), (torch.zeros(2).double(),)),
        ((torch.tensor([0.0]),), (torch.tensor([-0.0]),)),
        ((Room(0.03),), (Room(0.02),)),
        ((Room(0.03),), (Hall(0.03),)),
    ],
)
def test_fingerprints_tell_apart(first: tuple[Any, ...], second: tuple[Any, ...]) -> None:
    assert fingerprint(*first) != fingerprint(*second)


def test_a_fingerprint_of_something_else_is_refused() -> None:
    with pytest.raises(TypeError, match="Path"):
        fingerprint(Path("a"))


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package in which `start` imports `inner.near`, which imports `far` within a function; `other` is on its own."""
    package = tmp_path / "toy"
    (package / "inner").mkdir(parents=True)
    (package / "start.py").write_text("import os\nfrom toy.inner import near\n")
    (package / "inner/__init__.py").write_text("")
    (package / "inner/near.py").write_text("def f():\n    import toy.far\n")
    (package / "far.py").write_text("from toy.start import near\n")
    (package / "other.py").write_text("")
    monkeypatch.setattr(module, "PACKAGE", package)
    code_fingerprint.cache_clear()
    yield package
    code_fingerprint.cache_clear()


@pytest.mark.parametrize(
    ("file", "changes"),
    [("start", True), ("inner/near", True), ("inner/__init__", True), ("far", True), ("other", False)],
)
def test_changed_code_has_another_fingerprint(toy: Path, file: str, changes: bool) -> None:
    before = code_fingerprint("toy.start")
    path = toy / f"{file}.py"
    path.write_text(path.read_text() + "# changed\n")
    code_fingerprint.cache_clear()
    assert (code_fingerprint("toy.start") != before) == changes


def test_code_of_another_package_is_refused() -> None:
    with pytest.raises(ValueError, match="numpy"):
        code_fingerprint("numpy")


@pytest.mark.parametrize("library", ["torch", "numba", "llvmlite"])
def test_an_upgraded_library_changes_the_fingerprint(library: str, toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled loops compute what is kept, so that numba's versions are part of a key as torch's are."""
    before, version = code_fingerprint("toy.start"), module.version
    monkeypatch.setattr(module, "version", lambda name: f"{version(name)}.1" if name == library else version(name))
    code_fingerprint.cache_clear()
    assert code_fingerprint("toy.start") != before


def test_on_another_machine_nothing_is_kept(tmp_path: Path) -> None:
    there = pickle.loads(pickle.dumps(Cache(tmp_path)))
    assert there.folder is None and not there.holds("kind", "key")
    assert there.tensors("kind", "key", lambda: {"x": torch.ones(1)})["x"] == 1 and not [*tmp_path.iterdir()]
