"""Tensors that are computed once and shared by runs: a folder of files named by what went into them.

A key is a hash of inputs, settings, seed and code, so that any change gives a new key. An entry is one
safetensors file with a checksum; it is written atomically, by any number of processes. Whatever is
wrong with the folder costs time, never a result.
"""

from __future__ import annotations

import ast
import hashlib
import os
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from spgf_torch.files.writing import parts_in, write_bytes
from spgf_torch.progress import console

OFF = ("", "off", "false", "none", "null")
ENDING = ".safetensors"
CHECKSUM = "checksum"  # name of the tensor that holds it
TRIM_EVERY = 32  # entries written between two looks at the size of the folder: other processes write too
ROOM = 0.9  # of the limit is left after removing entries, so that not every new one removes another
ABANDONED = 3600  # s; a part this old was abandoned

PACKAGE = Path(__file__).parent
LIBRARIES = ("torch", "numpy", "numba", "llvmlite", "scipy", "trimesh", "embreex", "lightning")
# They compute nothing: the values of settings are part of a key themselves.
NOT_COMPUTING = (
    "spgf_torch.errors",
    "spgf_torch.settings",
    "spgf_torch.paths",
    "spgf_torch.progress",
    "spgf_torch.cache",
)

# Python 3.11 counts the depth of a syntax tree for all threads together: two that parse at once may fail (gh-106905).
_PARSING = Lock()


class Cache:
    """Named tensors by key, in `folder`; None = nothing is kept.

    At most `gigabytes` (1e9 bytes) stay, give or take what is being written: the least recently used entries go
    first. Threads and processes may share a folder. `hits` counts the entries read so far, by kind.
    """

    def __init__(self, folder: Path | None, gigabytes: float = 8.0) -> None:
        self.folder, self.limit = folder, int(gigabytes * 1e9)
        self.hits: Counter[str] = Counter()
        self._lock, self._written, self._size, self._warned = Lock(), 0, 0, False

    def __reduce__(self) -> tuple[type[Cache], tuple[None]]:
        """Keep nothing on another machine, where the folder may be another's or none."""
        return Cache, (None,)

    @staticmethod
    def open(folder: str | None, gigabytes: float) -> Cache:
        """The cache that the settings `cache` and `cache_gb` name; `off` or null for none."""
        return Cache(None if folder is None or folder.lower() in OFF else Path(folder).expanduser(), gigabytes)

    @contextmanager
    def going_on(self) -> Iterator[None]:
        """Who ends the work within is told, by a note of the exception, where the same call goes on from."""
        try:
            yield
        except KeyboardInterrupt as end:
            if self.folder is not None and self.folder.is_dir():
                end.add_note(f"what was done until then is kept in {self.folder}: the same call goes on from there")
            raise

    def tensors(self, kind: str, key: str, make: Callable[[], Mapping[str, Tensor]]) -> dict[str, Tensor]:
        """The tensors of the entry, on the CPU; made and kept where there is none, or a damaged one.

        Args:
            kind: a word, the first part of the file's name.
            key: `fingerprint` of everything that the tensors depend on.
            make: computes them; no two may share memory, none may be called "checksum".
        """
        if self.folder is None:
            return dict(make())
        path = self._path(kind, key)
        found = self._read(path)
        if found is None:
            found = dict(make())
            self._write(path, found)
        else:
            with self._lock:
                self.hits[kind] += 1
        return found

    def holds(self, kind: str, key: str) -> bool:
        """Whether there is an entry. It may be damaged, or gone when it is read: `tensors` then makes it again."""
        return self.folder is not None and self._path(kind, key).is_file()

    def _path(self, kind: str, key: str) -> Path:
        assert self.folder is not None
        return self.folder / f"{kind}-{key}{ENDING}"

    def _read(self, path: Path) -> dict[str, Tensor] | None:
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            self._warn(f"cannot read {path} ({error.strerror})")
            return None
        try:
            tensors = load(content)
        except (SafetensorError, ValueError, KeyError, RuntimeError):
            tensors = {}
        expected = tensors.pop(CHECKSUM, None)
        if expected is None or expected.tolist() != [checksum(path.stem, tensors)]:
            console.print(f"cache: {path} is damaged; made again")
            return None
        with suppress(OSError):  # a folder of another user, who keeps its order of use
            os.utime(path)
        return tensors

    def _write(self, path: Path, tensors: Mapping[str, Tensor]) -> None:
        """Write the entry; then see that the folder is not too large."""
        if self._warned:
            return
        entry = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
        content = save({**entry, CHECKSUM: torch.tensor([checksum(path.stem, entry)])})
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(path, content)
            self._trim(path.parent, len(content))
        except OSError as error:
            self._warn(f"cannot write to {self.folder} ({error.strerror}); going on without")

    def _trim(self, folder: Path, added: int) -> None:
        with self._lock:
            self._size += added
            self._written += 1
            if self._size > self.limit or self._written % TRIM_EVERY == 1:
                self._size = trim(folder, self.limit)

    def _warn(self, message: str) -> None:
        """One line a run, however many entries it concerns."""
        with self._lock:
            if not self._warned:
                console.print(f"cache: {message}")
            self._warned = True


def trim(folder: Path, limit: int) -> int:
    """Remove the least recently used entries where all together exceed `limit` bytes, and abandoned parts.

    Returns the size that is left, in bytes. An entry that is being read stays readable to its reader.
    """
    entries = []
    for path in folder.iterdir():
        with suppress(FileNotFoundError):  # another process removed it just now
            status = path.stat()
            if path.suffix == ENDING:
                entries.append((status.st_mtime_ns, status.st_size, path))
    for path in parts_in(folder):
        with suppress(FileNotFoundError):
            if time.time() - path.stat().st_mtime > ABANDONED:
                path.unlink()
    size = sum(entry[1] for entry in entries)
    if size > limit:
        for _, bytes_, path in sorted(entries):
            if size <= ROOM * limit:
                break
            path.unlink(missing_ok=True)
            size -= bytes_
    return size


def checksum(name: str, tensors: Mapping[str, Tensor]) -> int:
    """CRC-32 of an entry's name and of its tensors: names, types, shapes, values."""
    crc = zlib.crc32(name.encode())
    for label in sorted(tensors):
        values = tensors[label].numpy()
        crc = zlib.crc32(f"{label} {values.dtype} {values.shape}".encode(), crc)
        crc = zlib.crc32(values.data, crc)
    return crc


def fingerprint(*parts: Any) -> str:
    """SHA-256 of plain values, bytes, arrays, tensors, dataclasses, and of sequences and mappings of these.

    The order of a mapping's keys does not matter. Raises TypeError for anything else.
    """
    sha = hashlib.sha256()
    for token in _tokens(parts):
        sha.update(len(token).to_bytes(8, "little"))
        sha.update(token)
    return sha.hexdigest()


def _tokens(value: Any) -> Iterator[bytes | memoryview]:
    """What distinguishes `value` from any other; every token's length is hashed before it."""
    if isinstance(value, Tensor):
        value = value.detach().cpu().numpy()
    if isinstance(value, bytes):
        yield from (b"bytes", value)
    elif value is None or isinstance(value, bool | int | float | str):
        yield f"{type(value).__name__} {value!r}".encode()
    elif isinstance(value, np.ndarray):
        content = np.ascontiguousarray(value).reshape(-1).view(np.uint8)  # no copy: it may be a gigabyte
        yield from (f"array {value.dtype.str} {value.shape}".encode(), content.data)
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)}".encode()
        for key in sorted(value):
            yield from _tokens(key)
            yield from _tokens(value[key])
    elif isinstance(value, Sequence):
        yield f"sequence {len(value)}".encode()
        for entry in value:
            yield from _tokens(entry)
    elif is_dataclass(value):
        yield type(value).__qualname__.encode()
        yield from _tokens({entry.name: getattr(value, entry.name) for entry in fields(value)})
    else:
        raise TypeError(f"fingerprint: expected plain values, arrays and dataclasses, got {type(value).__name__}")


@lru_cache
def code_fingerprint(module: str) -> str:
    """Return the fingerprint of what a module of this package computes with.

    That is the source of the module and of all modules of the package that it imports, directly or not, and the
    versions of the numerical libraries.
    """
    sources: dict[str, bytes] = {}
    todo = [module]
    while todo:
        name = todo.pop()
        path = _source(name)
        if path is not None and name not in sources and name not in NOT_COMPUTING:
            sources[name] = path.read_bytes()
            todo += _imports(sources[name])
    if not sources:
        raise ValueError(f"code_fingerprint: expected a module of this package, got {module}")
    return fingerprint(sources, {name: version(name) for name in LIBRARIES})


def _source(module: str) -> Path | None:
    package, *rest = module.split(".")
    if package != PACKAGE.name:
        return None
    path = PACKAGE.joinpath(*rest)
    candidates = (path / "__init__.py", path.with_suffix(".py"))
    return next((candidate for candidate in candidates if candidate.is_file()), None)


def _imports(source: bytes) -> Iterator[str]:
    """Names that may be modules: what is imported, wherever in the source, and from where."""
    with _PARSING:
        tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
