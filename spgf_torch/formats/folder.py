"""Write a folder atomically: beside its place, flushed to disk, then exchanged.

It is written in a new hidden folder with a name of its own, which no call shares and nobody else can enter. Whoever is
killed on the way leaves the old folder as it was, or the new one, and that hidden folder; the next export removes it,
if it is this user's and says that it was made for this place.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import json
import os
import re
import shutil
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from spgf_torch.errors import InputError
from spgf_torch.files.writing import FRESH, sync
from spgf_torch.formats.card import CARD, files_of, listed_in
from spgf_torch.progress import console

AT_FDCWD, RENAME_EXCHANGE = -100, 2  # Linux: fcntl.h, stdio.h
FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
MARKER, NEW = "spgf_torch.export", "new"  # in the hidden folder: whose it is, and what is being written

Identity = tuple[int, int]  # device and inode


def check_out(out: Path, overwrite: bool, needed: Sequence[Path]) -> None:
    """Raises InputError in one line unless `out` can be made, is empty, or may be replaced.

    Only what an export made is replaced: a folder with a card, and no file that the card does not list. `needed` are
    folders that are read, which replacing must not remove.
    """
    out = _absolute(out)
    if (known := _identity(out)) is None:
        return
    if not stat.S_ISDIR(out.lstat().st_mode):
        raise InputError(f"out: expected a folder, got {out}, which is {'a link' if out.is_symlink() else 'a file'}")
    try:
        if not any(out.iterdir()):
            return
    except OSError as error:
        raise _unwritable(out, error) from None
    if not overwrite:
        raise InputError(f"out: expected an empty folder, got {out} with files in it (overwrite=true replaces it)")
    if inside := [path for path in needed if path.resolve().is_relative_to(out.resolve())]:
        raise InputError(f"out: expected a folder that may be replaced, got {out}, in which {inside[0]} stands")
    _check_made_by_export(out, known)


@contextmanager
def replacing(out: Path) -> Iterator[Path]:
    """An empty folder to write into, which takes the place of `out` at the end; removed where that is not reached.

    Raises InputError where there is no room, no right to write, another export at work on the same folder, or in `out`
    what no export made.
    """
    out = _absolute(out)
    old = _identity(out)
    if old is not None and any(out.iterdir()):
        _check_made_by_export(out, old)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        own = out.parent / f".spgf-export-{uuid4().hex}"
        own.mkdir(mode=0o700)
        lock = os.open(own, FOLDER)
    except OSError as error:
        raise _unwritable(out, error) from None
    mine = _identity(own)
    try:
        _claim(lock, own, out)
        (own / NEW).mkdir()
        yield own / NEW
        _flush(own / NEW)
        _exchange(own / NEW, out, old)
    except OSError as error:
        raise _unwritable(out, error) from None
    finally:
        if _identity(own) == mine:
            shutil.rmtree(own, ignore_errors=True)  # does not follow links
        os.close(lock)


def _absolute(out: Path) -> Path:
    """`out` with the folder that it stands in resolved; itself it may be a link."""
    out = out.resolve() if out.name in ("", "..") else out.absolute()
    return out.parent.resolve() / out.name


def _identity(path: Path) -> Identity | None:
    """Which file or folder it is, links not followed; None where nothing is there."""
    try:
        known = path.lstat()
    except FileNotFoundError:
        return None
    except OSError as error:  # a file among its parents, a name too long
        raise _unwritable(path, error) from None
    return known.st_dev, known.st_ino


def _check_made_by_export(out: Path, known: Identity) -> None:
    """Raises InputError unless an export made the folder, and all that is in it."""
    words = f"out: expected a folder that an export made, to be replaced, got {out}"
    try:
        listed = {*listed_in(out), CARD}
    except InputError as error:
        raise InputError(f"{words}: {error}") from None
    if others := sorted(files_of(out).keys() - listed):
        raise InputError(f"{words} with {others[0]}, which is not on its {CARD}: move it elsewhere first")
    if _identity(out) != known:
        raise InputError(f"{words}, which was changed meanwhile")


def _claim(lock: int, own: Path, out: Path) -> None:
    """Lock the hidden folder, which the system undoes when the process ends in any way, and write whose it is.

    Others of the same place are removed where their process has ended; where it has not, InputError.
    """
    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with os.fdopen(os.open(MARKER, FRESH, 0o600, dir_fd=lock), "w") as file:
        json.dump(_claim_of(own, out), file)
    for other in out.parent.iterdir():
        if other != own and re.fullmatch(r"\.spgf-export-[0-9a-f]{32}", other.name):
            _remove_left(other, out)


def _claim_of(own: Path, out: Path) -> list[str | int]:
    """What the marker says: the place that is written to, and the very folder that it lies in, so that no copy or link
    of a marker says it of another.
    """
    return [out.name, *(_identity(own) or ())]


def _remove_left(other: Path, out: Path) -> None:
    """Remove what a killed export into `out` left; leave what only looks so."""
    try:
        handle = os.open(other, FOLDER)
    except OSError:
        return
    try:
        if os.fstat(handle).st_uid != os.geteuid() or not _is_marked(handle, other, out):
            return
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                raise
            raise InputError(f"out: expected no other export into {out}, got one at work in {other.name}") from None
        console.print(f"export: removing what an export that was cut off left in {other}", markup=False)
        shutil.rmtree(other)
    finally:
        os.close(handle)


def _is_marked(handle: int, other: Path, out: Path) -> bool:
    try:
        marker = os.open(MARKER, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, dir_fd=handle)
    except OSError:
        return False
    try:
        about = os.fstat(marker)
        if not stat.S_ISREG(about.st_mode) or about.st_uid != os.geteuid() or about.st_nlink != 1:
            return False
        return bool(json.loads(os.read(marker, 4096)) == _claim_of(other, out))
    except (ValueError, RecursionError):
        return False
    finally:
        os.close(marker)


def _flush(folder: Path) -> None:
    """Every file, then every folder, onto the disk."""
    for parent, _, names in os.walk(folder, topdown=False):
        for name in names:
            handle = os.open(Path(parent, name), os.O_RDONLY | os.O_NOFOLLOW)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
        sync(Path(parent))


def _exchange(new: Path, out: Path, old: Identity | None) -> None:
    """`new` becomes `out`; what was there before, if anything, is then called `new`."""
    if out.is_dir() and not out.is_symlink() and any(out.iterdir()):
        _swap(new, out)
        if _identity(new) != old:  # another process put another one there meanwhile
            _swap(new, out)
            raise OSError(0, "it was made or changed by another process meanwhile")
    else:
        new.rename(out)  # fails where a file or a link is there
    with suppress(OSError):
        sync(out.parent)


def _swap(new: Path, out: Path) -> None:
    """Exchange their names in one step."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.renameat2(AT_FDCWD, os.fsencode(new), AT_FDCWD, os.fsencode(out), RENAME_EXCHANGE) != 0:
        reason = os.strerror(ctypes.get_errno())
        raise OSError(0, f"cannot exchange it with the new one in one step: {reason}; remove it first")


def _unwritable(out: Path, error: OSError) -> InputError:
    return InputError(f"out: expected a folder that can be written, got {out} ({error.strerror or error})")
