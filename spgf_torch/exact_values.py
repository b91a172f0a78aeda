"""Plain values whose types are those that a dataclass declares: taken as they are, in a millisecond.

OmegaConf takes a tenth of a second for the settings of a command. What it would convert from another type, merge into
a default, or refuse, is `InexactError` here: then it decides.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

MISSING = "???"  # OmegaConf's word for a value that must be given


class InexactError(Exception):
    """A value is not of the declared type, or none is given and there is no default."""


@cache
def hints(kind: Any) -> dict[str, Any]:
    """The types of a dataclass's fields by their names."""
    return get_type_hints(kind)


def filled(kind: Any, given: Any, over: Any = None) -> dict[str, Any]:
    """All fields of a dataclass as nested plain values: those of `given`, else of `over`, else the defaults.

    Both are mappings or instances of the dataclass. A whole number where a number is declared becomes a float.
    """
    given, over = _mapping(kind, given), None if over is None else _mapping(kind, over)
    types = hints(kind)
    if not given.keys() <= types.keys():
        raise InexactError
    values = {}
    for entry in dataclasses.fields(kind):
        name, of = entry.name, types[entry.name]
        if name in given:
            below = over.get(name) if over else _default(entry) if _merges(of, given[name]) else None
            values[name] = _value(of, given[name], below)
        else:
            values[name] = _value(of, over[name] if over and name in over else _default(entry), None)
    return values


def built(kind: Any, values: Mapping[str, Any]) -> Any:
    """The instance of a dataclass that has these values, as `filled` gives them."""
    types = hints(kind)
    return kind(**{name: _object(types[name], value) for name, value in values.items()})


def _mapping(kind: Any, values: Any) -> Mapping[str, Any]:
    if type(values) is dict:
        return values
    if type(values) is kind:
        return {entry.name: getattr(values, entry.name) for entry in dataclasses.fields(kind)}
    raise InexactError


def _default(entry: dataclasses.Field) -> Any:
    if entry.default_factory is not dataclasses.MISSING:
        return entry.default_factory()
    return MISSING if entry.default is dataclasses.MISSING else entry.default


def _merges(of: Any, value: Any) -> bool:
    """Whether OmegaConf merges a value into the default instead of putting it in its place."""
    return type(value) is dict or is_dataclass(of)


def _value(of: Any, value: Any, below: Any) -> Any:
    """A value of the declared type `of`, plain; `below` is the default beneath keys and values, if there is one."""
    of, below = _beside_none(of, value), None if below == MISSING else below
    if of is NoneType:
        return None
    if is_dataclass(of):
        return filled(of, value, below)
    if of is Any:
        return _anything(value, below)
    if of is float and type(value) is int:
        return float(value)
    if of in (bool, int, float, str) and type(value) is of and value != MISSING:
        return value
    if get_origin(of) is list and type(value) in (list, tuple):
        return [_value(get_args(of)[0], part, None) for part in value]
    if get_origin(of) is dict and type(value) is dict and not below:
        keys, parts = get_args(of)
        return {_value(keys, key, None): _value(parts, part, None) for key, part in value.items()}
    raise InexactError


def _beside_none(of: Any, value: Any) -> Any:
    """`X` of a declared `X | None`; `None`'s type if that is the value."""
    if get_origin(of) in (Union, UnionType) and len(rest := set(get_args(of)) - {NoneType}) == 1:
        return NoneType if value is None else rest.pop()
    return of


def _anything(value: Any, below: Any) -> Any:
    """Plain values of any type."""
    if type(value) is dict and not below:
        return {_value(str, key, None): _anything(part, None) for key, part in value.items()}
    if type(value) in (list, tuple):
        return [_anything(part, None) for part in value]
    if type(value) in (bool, int, float, str, NoneType) and value != MISSING:
        return value
    raise InexactError


def _object(of: Any, value: Any) -> Any:
    of = _beside_none(of, value)
    if is_dataclass(of):
        return built(of, value)
    if get_origin(of) is dict and is_dataclass(parts := get_args(of)[1]):
        return {key: built(parts, part) for key, part in value.items()}
    return value
