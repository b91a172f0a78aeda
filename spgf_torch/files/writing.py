"""Atomic writes: a file is complete or absent, even after a kill or on a full disk."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

from spgf_torch.errors import InputError

_PART = re.compile(r"\.[0-9a-f]{32}\.part")
UNABLE = (errno.EINVAL, errno.ENOTSUP, errno.EBADF)  # of network file systems that cannot flush a folder
FRESH = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC


def check_place(name: str, path: str | Path | None) -> None:
    """InputError where a file is at `path`, the setting `name`, or on the way to it: no folder can be made there."""
    place = Path(path).expanduser() if path else None
    for each in () if place is None else (place, *place.parents):
        if os.path.lexists(each) and not each.is_dir():
            got = "a link to nothing" if each.is_symlink() and not each.exists() else "a file"
            raise InputError(f"{name}: expected a folder, new or there already, got {got} at {each}")


def write_text(path: Path, content: str) -> None:
    """The same as `write_bytes` for text, in UTF-8."""
    write_bytes(path, content.encode())


def write_bytes(path: Path, content: bytes | memoryview) -> None:
    """Write to a new name beside `path`, flush to disk, rename, flush the folder's entry.

    Raises OSError, which names `path`, where that cannot be done; then the file that was there stays as it was, and
    nothing else is left.
    """
    part = path.with_name(f".{uuid4().hex}.part")
    try:
        handle = os.open(part, FRESH, 0o666)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        except BaseException:
            with suppress(OSError):
                part.unlink()
            raise
        sync(path.parent)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def sync(folder: Path) -> None:
    """Flush a folder's entries to disk: a renamed file is there after a power cut as well."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in UNABLE:
            raise
    finally:
        os.close(handle)


def parts_in(folder: Path) -> Iterator[Path]:
    """Find the parts that a killed `write_bytes` left in a folder, and no other files."""
    for path in folder.iterdir():
        if _PART.fullmatch(path.name) and path.is_file() and not path.is_symlink():
            yield path
