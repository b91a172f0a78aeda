"""A hand's description in a YAML file of one's own: the keys are those of `conf/hand/*.yaml` (docs/howto/hand.md)."""

from __future__ import annotations

from difflib import get_close_matches
from pathlib import Path
from typing import Any

from spgf_torch.errors import InputError
from spgf_torch.files.reading import yaml_values
from spgf_torch.hands.config import HandConfig
from spgf_torch.settings import plain, typed

WHAT = "a hand's description in YAML"
DESCRIPTIONS, URDFS = (".yaml", ".yml"), (".urdf", ".xacro")


def is_file_name(value: str) -> bool:
    """Whether `hand=value` names a file: it has a slash, or ends as descriptions and URDFs do."""
    return "/" in value or value.lower().endswith((*DESCRIPTIONS, *URDFS))


def is_urdf(value: str) -> bool:
    """Whether a name ends as URDFs do."""
    return value.lower().endswith(URDFS)


def read_description(path: str | Path) -> HandConfig:
    """The description in a file, its `urdf` and `packages` found from the folder that the file is in.

    What they name there becomes an absolute path, so that a model finds its hand again from any folder; anything else
    stays as it is. `name`, where the file gives none, is that of the file.

    Raises InputError: no such file, not YAML, a key or value that a description has not.
    """
    path = there(Path(path).expanduser())
    if is_urdf(path.name):
        command = f"python -m spgf_torch.hand hand={path}"
        raise InputError(f"hand: expected {WHAT}, got the URDF {path}; {command} proposes one")
    values = yaml_values(path, WHAT)
    if not isinstance(values, dict):
        raise InputError(f"{path}: expected {WHAT}, got {type(values).__name__}")
    values.setdefault("name", path.stem)
    try:
        config = typed(HandConfig, values)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    config.urdf = _from(path.parent, config.urdf)
    config.packages = {name: _from(path.parent, folder) for name, folder in config.packages.items()}
    return config


def described(path: str | Path) -> dict[str, Any]:
    """The same as plain values, for Hydra; every key is there, so that each can be set beside `hand=FILE`."""
    return plain(read_description(path))


def there(path: Path) -> Path:
    """`path`, if there is something; InputError with the nearest name in its folder where there is not."""
    if path.exists():
        return path
    folder = path.parent
    beside = [entry.name for entry in folder.iterdir()] if folder.is_dir() else []
    near = get_close_matches(path.name, [name for name in beside if is_file_name(name)], 1, 0.6)
    got = f"nothing there at {path}" if beside or folder.is_dir() else f"no folder {folder}"
    raise InputError(
        f"hand: expected {WHAT} or a URDF, got {got}{f'; did you mean {folder / near[0]}?' if near else ''}"
    )


def _from(folder: Path, name: str) -> str:
    beside = folder / Path(name).expanduser()
    return str(beside.resolve()) if name and "://" not in name and beside.exists() else name
