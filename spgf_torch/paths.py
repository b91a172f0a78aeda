"""Where settings and data stand: in the repository, or in the package itself when it came as a wheel."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from spgf_torch.errors import InputError


def root() -> Path:
    """The folder that holds `conf` and `data`: the package's own copy in a wheel, else the repository."""
    packaged = Path(__file__).parent / "_shipped"
    return packaged if packaged.is_dir() else Path(__file__).parent.parent


def path_of(name: str, given: Any) -> Path:
    """A path that somebody gave as `name`, the home folder's `~` read; InputError where it is no path."""
    if not isinstance(given, str | os.PathLike):
        raise InputError(f"{name}: expected a path, got {given!r:.40}")
    return Path(given).expanduser()


def find(path: str | Path) -> Path:
    """`path` as given if it exists (relative to the working folder), else below `root()`."""
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"{path!r:.40}: expected the path of a file or folder, got {type(path).__name__}")
    if "\0" in str(path):
        raise InputError(f"{path}: expected a file or folder, got a name with a zero in it")
    try:
        given = Path(path).expanduser()
        shipped = root() / given
        return shipped if not given.exists() and shipped.exists() else given
    except (OSError, RuntimeError) as error:  # a name too long; ~user of an unknown user
        raise InputError(
            f"{path}: expected a file or folder, got {getattr(error, 'strerror', None) or error}"
        ) from None
