"""`hand=FILE`: a description in a file becomes an option of Hydra's group `hand`, as those in `conf/hand` are."""

from __future__ import annotations

import re
from pathlib import Path

from hydra.core.config_store import ConfigStore

from spgf_torch.hands.description_file import described, is_urdf
from spgf_torch.paths import root

GROUP = "hand"

# Files that have been read, absolute, with the names of their options: one file is one option.
_options: dict[Path, str] = {}


def option_of(value: str) -> str:
    """The name of the option that stands for the file `value`, which is read and kept for Hydra.

    It is the file's own name as far as Hydra's grammar allows, and no name that `conf/hand` has, since that would win;
    the name of a run's folder shows it. Raises InputError for what is no description.
    """
    path = Path(value).expanduser()
    values = described(path)
    kept = path.resolve()
    if kept not in _options:
        stem = re.sub(r"[^\w+-]", "-", path.stem)
        taken = {known.stem for known in (root() / "conf" / GROUP).glob("*.yaml")} | set(_options.values())
        names = [stem, f"{stem}_file", *(f"{stem}_file{number}" for number in range(2, len(taken) + 3))]
        _options[kept] = next(name for name in names if name not in taken)
    ConfigStore.instance().store(group=GROUP, name=_options[kept], node=values)
    return _options[kept]


def proposed(command: str, value: str) -> bool:
    """Whether `hand=value` asks for a description of a bare URDF, which only the command `hand` makes."""
    return command == "hand" and is_urdf(value)
