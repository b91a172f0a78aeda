"""Typed settings: ranges and choices of values, defaults from `conf/`, and the wording of what is wrong with them.

The values live in `conf/` (one YAML file a sub-package, each value with its reason); the dataclasses in their
`config.py` give each key a type and a range. `FeatureConfig()` has the default values, read without Hydra;
`settings(FeatureConfig, radius=0.02)` checks what is changed.

Lengths are metres, masses kilograms, times seconds; angles are degrees in settings (and only there).
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from copy import deepcopy
from dataclasses import Field, field, fields, is_dataclass
from difflib import get_close_matches
from functools import cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar, get_origin

from omegaconf import MISSING, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from spgf_torch.errors import InputError
from spgf_torch.exact_values import InexactError, built, filled, hints
from spgf_torch.paths import root

T = TypeVar("T")


def bounded(low: float, high: float, default: Any = MISSING) -> Any:
    """A number within [low, high], required unless there is a default."""
    return field(default=default, metadata={"range": (low, high)})


def choice(*options: str, default: Any = MISSING) -> Any:
    """A word, one of `options`, required unless there is a default."""
    return field(default=default, metadata={"choice": options})


def text(default: Any = MISSING) -> Any:
    """A string or path; its meaning is checked where it is used."""
    return field(default=default)


def left_out() -> Any:
    """A group of settings that is nothing unless it is given; then `plain` does not name it either."""
    return field(default=None, metadata={LEFT_OUT: True})


# Marks of a field that what is read from elsewhere must give, and of one that is named only where it is given.
REQUIRED, LEFT_OUT = "required", "left_out"


def defaults_from(path: str) -> Callable[[type[T]], type[T]]:
    """Give the required fields of a dataclass to be their defaults in `conf/<path>`, read when an instance is made.

    What is read from elsewhere (`typed`) must still give each of them.
    """

    def give(kind: type[T]) -> type[T]:
        for name in kind.__annotations__:
            entry = vars(kind).get(name)
            if isinstance(entry, Field) and entry.default == MISSING:
                entry.default, entry.default_factory = dataclasses.MISSING, partial(_default, path, name)
                entry.metadata = MappingProxyType({**entry.metadata, REQUIRED: True})
        kind.DEFAULTS = path  # type: ignore[attr-defined]
        return kind

    return give


def _default(path: str, name: str) -> Any:
    return deepcopy(_values(path)[name])


@cache
def _values(path: str) -> dict[str, Any]:
    return dict(_plain(OmegaConf.load(root() / "conf" / path)))


def _given(kind: Any, values: Any, prefix: str) -> None:
    """InputError for the first required field of a dataclass that `values` lack, at any depth."""
    if is_dataclass(values):  # an instance: its fields are set
        return
    types = hints(kind)
    for entry in fields(kind):
        name, of = prefix + entry.name, types[entry.name]
        if is_dataclass(of):
            _given(of, (values or {}).get(entry.name, {}), name + ".")
        elif entry.metadata.get(REQUIRED) and entry.name not in (values or {}):
            raise InputError(f"{name}: expected a value, got none")


def settings(kind: type[T], **changes: Any) -> T:
    """Read the default settings of a sub-package from `conf/` without Hydra, with `changes` applied."""
    given = {key: _python(value) for key, value in changes.items()}
    return typed(kind, {**_values(kind.DEFAULTS), **given})  # type: ignore[attr-defined]


def typed(kind: type[T], values: Any) -> T:
    """`values` (a mapping) as an instance of the dataclass `kind`.

    Raises InputError in one line for a key that does not exist, a wrong type or a number out of range, and for
    `${...}`: Hydra has resolved the settings' own, and in a file read from elsewhere it would read the environment.
    """
    try:
        _check_literal(values, "")
        given = _named(_plain(values))
        _check_mappings(kind, given, "")
        try:
            result = built(kind, filled(kind, given))
            _given(kind, given, "")
        except InexactError:
            merged = OmegaConf.merge(_structured(kind), OmegaConf.create(given))  # type: ignore[arg-type]  # a class is hashable
            _given(kind, given, "")
            result = OmegaConf.to_object(merged)
    except MissingMandatoryValue as error:
        raise InputError(f"{error.full_key or error.key}: expected a value, got none") from None
    except OmegaConfBaseException as error:
        raise InputError(_one_line(error)) from None
    _check(result, "")
    return result  # type: ignore[no-any-return]


@cache
def _structured(kind: Any) -> Any:
    """The types and defaults of a dataclass as OmegaConf has them, which takes it as long as merging values."""
    return OmegaConf.structured(kind)


def plain(config: Any) -> dict[str, Any]:
    """A settings dataclass as nested dicts and lists of plain Python values."""
    try:
        values = filled(type(config), config)
    except InexactError:
        values = _plain(OmegaConf.structured(config))
    return _named_only(config, values)


def _named_only(config: Any, values: dict[str, Any]) -> dict[str, Any]:
    """`values` of a dataclass without what it leaves out."""
    for entry in fields(config):
        value = getattr(config, entry.name)
        if is_dataclass(value):
            _named_only(value, values[entry.name])
        elif value is None and entry.metadata.get(LEFT_OUT):
            del values[entry.name]
    return values


def _python(value: Any) -> Any:
    """A value of a setting given in Python: arrays, tensors, their numbers and paths as plain values."""
    if isinstance(value, list | tuple):
        return [_python(part) for part in value]
    if isinstance(value, Path):
        return str(value)
    return value.tolist() if callable(getattr(value, "tolist", None)) else value


def _plain(values: Any) -> Any:
    return OmegaConf.to_container(values, resolve=True) if OmegaConf.is_config(values) else values


def _check_mappings(kind: Any, values: Any, prefix: str) -> None:
    """InputError for a list where a dataclass has keys and values, at any depth: OmegaConf would not name it."""
    types = hints(kind)
    for entry in fields(kind):
        of, value = types[entry.name], values.get(entry.name) if isinstance(values, dict) else None
        if isinstance(value, list) and (get_origin(of) is dict or is_dataclass(of)):
            raise InputError(f"{prefix}{entry.name}: expected keys and values, got a list")
        if is_dataclass(of):
            _check_mappings(of, value, f"{prefix}{entry.name}.")


def _named(value: Any) -> Any:
    """The same with whole numbers as keys made text: some hands call their joints 0, 1, 2."""
    if isinstance(value, dict):
        return {str(key) if isinstance(key, int) else key: _named(part) for key, part in value.items()}
    return [_named(part) for part in value] if isinstance(value, list) else value


# OmegaConf's words in ours.
_WORDS = {
    r"^Value '(.*)' is not a valid bool \(type \w+\)$": r"expected true or false, got \1",
    r"^Value '(.*)' of type '\w+' could not be converted to (\w+)$": r"expected a value of type \2, got \1",
    r"^Incompatible value '(.*)' for field of type '(\w+)'$": r"expected a value of type \2, got \1",
    r"^Cannot convert '(\w+)' to string: '(.*)'$": r"expected text, got \2",
    r"^field '(\w+)' is not Optional$": r"\1: expected a value, got none",
    r"^Invalid value assigned: \w+ is not a ListConfig, list or tuple\.$": "expected a list, as [A,B]; got one value",
    r"^Object of unsupported type: '(\w+)'$": r"expected keys and values, got \1",
    r"^Invalid type assigned: \w+ is not a subclass of (\w+)\. value: (.*)$": r"expected keys of \1, got \2",
}


def _one_line(error: OmegaConfBaseException) -> str:
    message = str(error.msg or error).splitlines()[0].strip()
    unknown = re.match(r"^Key '(.*)' not in '\w+'$", message)
    kind = getattr(error, "object_type", None)
    if unknown and isinstance(kind, type) and is_dataclass(kind):
        near = get_close_matches(unknown[1], [entry.name for entry in fields(kind)], 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        named = str(getattr(error, "full_key", None) or unknown[1])
        return f"{named}: expected a key of {kind.__name__}, got {unknown[1]}{hint}"
    for pattern, words in _WORDS.items():
        message = re.sub(pattern, words, message)
    key = getattr(error, "full_key", None)
    return f"{key}: {message}" if key and not message.startswith(f"{key}:") else message


def _check_literal(value: Any, name: str) -> None:
    if isinstance(value, str) and "${" in value:
        raise InputError(f"{name}: expected a plain value, got {value}")
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list | tuple) else ()
    for key, part in parts:
        _check_literal(part, f"{name}.{key}" if name else str(key))


def _check(config: Any, prefix: str) -> None:
    for entry in fields(config):
        value, name = getattr(config, entry.name), prefix + entry.name
        if is_dataclass(value):
            _check(value, name + ".")
        elif isinstance(value, dict):
            for key, part in value.items():
                if is_dataclass(part):
                    _check(part, f"{name}.{key}.")
        elif "range" in entry.metadata:
            low, high = entry.metadata["range"]
            if value is not None and not low <= value <= high:
                raise InputError(f"{name}: expected a number from {low:g} to {high:g}, got {value}")
        elif "choice" in entry.metadata and value not in entry.metadata["choice"]:
            raise InputError(f"{name}: expected one of {', '.join(entry.metadata['choice'])}; got {value}")
