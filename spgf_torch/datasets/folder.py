"""A folder that is there as a whole or not at all: written beside its place, flushed to disk, then exchanged.

Whoever is killed on the way leaves the old folder as it was, or the new one, and perhaps a hidden folder beside it
that the next export removes.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from spgf_torch.config import InputError
from spgf_torch.progress import console

AT_FDCWD, RENAME_EXCHANGE = -100, 2  # Linux: fcntl.h, stdio.h


def check_out(out: Path, overwrite: bool, needed: Sequence[Path]) -> None:
    """Raises InputError in one line unless `out` can be made, is empty, or may be replaced.

    `needed` are folders that are read, which replacing must not remove.
    """
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        raise InputError(f"out: expected a folder, got {out}, which is {'a link' if out.is_symlink() else 'a file'}")
    if not out.is_dir() or not any(out.iterdir()):
        return
    if not overwrite:
        raise InputError(f"out: expected an empty folder, got {out} with files in it (overwrite=true replaces it)")
    inside = [path for path in needed if path.resolve().is_relative_to(out.resolve())]
    if inside:
        raise InputError(f"out: expected a folder that may be replaced, got {out}, in which {inside[0]} stands")


@contextmanager
def replacing(out: Path) -> Iterator[Path]:
    """An empty folder to write into, which takes the place of `out` at the end; removed where that is not reached.

    Raises InputError where there is no room, no right to write, or another export at work on the same folder.
    """
    part = out.parent / f".{out.name}.part"
    try:
        part.mkdir(parents=True, exist_ok=True)
        lock = os.open(part, os.O_RDONLY)
    except OSError as error:
        raise _unwritable(out, error) from None
    try:
        _claim(lock, part)
        try:
            yield part
            _flush(part)
            _exchange(part, out)
        except OSError as error:
            raise _unwritable(out, error) from None
        finally:
            shutil.rmtree(part, ignore_errors=True)
    finally:
        os.close(lock)


def _claim(lock: int, part: Path) -> None:
    """Lock the folder, which the system undoes when the process ends in any way, and remove what is in it."""
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
            raise _unwritable(part, error) from None
        raise InputError(f"out: expected no other export into {part.parent}, got one at work in {part.name}") from None
    left = list(part.iterdir())
    if left:
        console.print(f"export: removing what an export that was cut off left in {part}")
    for path in left:
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()


def _flush(folder: Path) -> None:
    """Every file, then every folder, onto the disk."""
    for parent, _, names in os.walk(folder, topdown=False):
        for path in (*(Path(parent, name) for name in names), Path(parent)):
            handle = os.open(path, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)


def _exchange(part: Path, out: Path) -> None:
    """`part` becomes `out`; what was there before, if anything, is then called `part`."""
    if out.is_dir() and any(out.iterdir()):
        libc = ctypes.CDLL(None, use_errno=True)
        done = libc.renameat2(AT_FDCWD, os.fsencode(part), AT_FDCWD, os.fsencode(out), RENAME_EXCHANGE)
        if done != 0:
            reason = os.strerror(ctypes.get_errno())
            raise OSError(0, f"cannot exchange it with the new one in one step: {reason}; remove it first")
    else:
        part.rename(out)
    with suppress(OSError):  # some network file systems cannot flush a folder
        handle = os.open(out.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _unwritable(out: Path, error: OSError) -> InputError:
    return InputError(f"out: expected a folder that can be written, got {out} ({error.strerror or error})")
