"""Whether what the settings name is there at all: asked before anything that takes seconds to import."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from spgf_torch.config import InputError, find
from spgf_torch.reading import existing


def check_files(config: Any, needed: str, *others: str) -> None:
    """InputError for the first file of these settings, one or a list each, that is missing, empty or a folder.

    One at least must be `needed`; others that the config has not, that are null or hold numbers are left to who reads
    them.
    """
    if not list(_words(getattr(config, needed))):
        raise InputError(f"{needed}: expected a file or a list of files ({needed}=FILE), got none")
    for name in (needed, *others):
        for path in _words(getattr(config, name, None)):
            existing(find(path))


def check_folder(name: str, path: str, what: str) -> None:
    """InputError unless `path`, the setting `name`, is a folder with something in it."""
    folder = find(path)
    try:
        got = "a file" if folder.is_file() else "nothing there" if not folder.is_dir() else ""
        got = got or ("" if any(folder.iterdir()) else "an empty folder")
    except (OSError, ValueError) as error:
        got = str(getattr(error, "strerror", None) or error)
    if got:
        raise InputError(f"{name}: expected {what}, got {got} at {path}")


def check_model(path: str) -> None:
    """InputError unless the folder holds a model, as far as its names tell."""
    folder = find(path)
    for name in ("model.json", "model.safetensors"):
        if not (folder / name).is_file():
            raise InputError(f"{folder / name}: expected a model that train left (make train), found no such file")


def check_judge(path: str | None) -> None:
    """InputError unless the folder holds a judge, as far as its names tell; None is none."""
    if path is None:
        return
    for name in ("judge.json", "judge.safetensors"):
        if not (find(path) / name).is_file():
            raise InputError(
                f"judge: expected a folder that python -m spgf_torch.judge left, found no {name} in {path}"
            )


def _words(value: Any) -> Iterator[str | Path]:
    if isinstance(value, str | Path) and value:
        yield value
    elif isinstance(value, list | tuple):
        yield from (each for each in value if isinstance(each, str | Path) and each)
