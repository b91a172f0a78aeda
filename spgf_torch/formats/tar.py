"""Tar files for WebDataset: written so that the same content gives the same bytes, read without trust."""

from __future__ import annotations

import io
import tarfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from spgf_torch.errors import InputError
from spgf_torch.files.reading import unreadable

LARGEST = 64_000_000  # bytes of one file in a shard; the grasps of an object, 160 bytes each
END = 2 * tarfile.BLOCKSIZE  # bytes of zeros that end a tar


@contextmanager
def written(path: Path) -> Iterator[BinaryIO]:
    """A new tar file, to which `add` adds; at the end it is filled up to whole records, as every tar."""
    with path.open("wb") as file:
        yield file
        file.write(bytes(END))
        file.write(bytes(-file.tell() % tarfile.RECORDSIZE))


def add(file: BinaryIO, name: str, content: bytes) -> None:
    """Add a file without owner and time. (`TarFile.addfile` would take twice as long for many small ones.)"""
    member = tarfile.TarInfo(name)
    member.size = len(content)
    file.write(member.tobuf(tarfile.GNU_FORMAT))
    file.write(content)
    file.write(bytes(-len(content) % tarfile.BLOCKSIZE))


def samples(path: Path) -> Iterator[tuple[str, dict[str, bytes]]]:
    """Each sample of a shard: its `__key__`, and ending -> content. Files of a sample stand beside each other.

    Raises InputError in one line for a file that is missing, cut off, or no tar.
    """
    check_whole(path)
    key, files = "", dict[str, bytes]()
    for name, content in _members(path):
        stem, _, ending = name.rpartition("/")[2].partition(".")
        if stem != key and files:
            yield key, files
            files = {}
        key = stem
        if not ending or ending in files:
            raise InputError(f"{path}: expected files KEY.ENDING, each once, got {name!r:.80}")
        files[ending] = content
    if files:
        yield key, files


def check_whole(path: Path) -> None:
    """Raises InputError in one line for a shard that is missing or cut off, without reading it.

    A tar has whole records and ends in zeros. Cut off between two members, or in the last record's padding, it would
    read like a shorter one.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected a WebDataset shard, got {'a folder' if path.is_dir() else 'no such file'}")
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(-min(END, size), io.SEEK_END)
        if size % tarfile.RECORDSIZE or file.read() != bytes(END):
            raise InputError(f"{path}: expected a WebDataset shard, got one that was cut off ({size} bytes)")


def _members(path: Path) -> Iterator[tuple[str, bytes]]:
    """Names and contents of regular files."""
    try:
        with tarfile.open(path, "r:") as tar:
            for member in tar:
                content = tar.extractfile(member) if member.isreg() and not member.issparse() else None
                if content is None or member.size > LARGEST:
                    got = "which is none" if content is None else f"of {member.size} bytes"
                    raise InputError(
                        f"{path}: expected files of at most {LARGEST} bytes, got {member.name!r:.80}, {got}"
                    )
                yield member.name, content.read()
    except InputError:
        raise
    except (tarfile.TarError, OSError, ValueError, EOFError) as error:
        raise unreadable(path, "a WebDataset shard", error) from None
