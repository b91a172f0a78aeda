"""The settings of a command as conf/ has them, read without Hydra: what it would compose of the same choices."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from spgf_torch.errors import InputError
from spgf_torch.paths import root

OWN = "_self_"


def command_settings(command: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Plain values of `conf/<command>.yaml` with its groups, changed.

    Args:
        changes: key -> value; of a group a mapping of what changes in it, or the name of another option
            (`episode="fast"`); keys of keys may be joined by points, as on the command line (`sensing.cameras`).

    Raises InputError for an option that a group has not. Whether keys exist, and values are possible, is for `typed`.
    """
    return _changed(root(), command, changes) if changes else deepcopy(_defaults(root(), command))


@cache
def _defaults(place: Path, command: str) -> dict[str, Any]:
    """Without changes: a run asks several times what stands for a setting that was not given."""
    return _changed(place, command, {})


def _changed(place: Path, command: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """`command_settings`, made anew, of the `conf/` in a place."""
    own = _read(place / "conf" / f"{command}.yaml")
    groups = _groups(own)
    values: Any = OmegaConf.create({})
    for group, option in groups.items():
        chosen = changes.get(group, option)
        values[group] = _option(group, chosen if isinstance(chosen, str) else option)
    values = OmegaConf.merge(values, own)
    OmegaConf.set_struct(values, False)
    for key, value in changes.items():
        if key not in groups or not isinstance(value, str):
            try:
                OmegaConf.update(values, key, value, merge=True)
            except OmegaConfBaseException as error:
                raise InputError(f"{key}: {str(error).splitlines()[0]}") from None
    plain: dict[str, Any] = OmegaConf.to_container(values, resolve=True)  # type: ignore[assignment]
    return plain


def _groups(own: DictConfig) -> dict[str, str]:
    """Group -> option, of a command's defaults list, which is taken from its values, as what is Hydra's own is."""
    listed = OmegaConf.to_container(own.pop("defaults"))
    own.pop("hydra", None)
    pairs = [pair for entry in listed if isinstance(entry, dict) for pair in entry.items()]  # type: ignore[union-attr]
    return {str(group): str(option) for group, option in pairs if not str(group).startswith("override ")}


def _option(group: str, name: str) -> DictConfig:
    """The values of `conf/<group>/<name>.yaml`, over those of the options of the group that it names."""
    folder = root() / "conf" / group
    options = sorted(path.stem for path in folder.glob("*.yaml"))
    if name not in options:
        near = get_close_matches(name, options, 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise InputError(f"{group}: expected one of {', '.join(options)}; got {name or 'none'}{hint}")
    values = _read(folder / f"{name}.yaml")
    below = [entry for entry in values.pop("defaults", []) if entry != OWN]
    merged = OmegaConf.merge(*(_option(group, entry) for entry in below), values)
    assert isinstance(merged, DictConfig)  # of mappings
    return merged


def _read(path: Path) -> DictConfig:
    return deepcopy(_loaded(path))


@cache
def _loaded(path: Path) -> DictConfig:
    loaded = OmegaConf.load(path)
    assert isinstance(loaded, DictConfig)  # conf/ holds mappings alone
    return loaded
