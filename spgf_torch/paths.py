"""Where settings and data stand: in the repository, or in the package itself when it came as a wheel."""

from __future__ import annotations

from pathlib import Path

from spgf_torch.errors import InputError


def root() -> Path:
    """The folder that holds `conf` and `data`: the package's own copy in a wheel, else the repository."""
    packaged = Path(__file__).parent / "_shipped"
    return packaged if packaged.is_dir() else Path(__file__).parent.parent


def find(path: str | Path) -> Path:
    """`path` as given if it exists (relative to the working folder), else below `root()`."""
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
