"""Settings as people read them: each key of conf/ with its default and the comment beside it, ranges from dataclasses.

Nothing is written twice: the help of a command, shell completion and the pages in docs/ are made from these.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import get_args, get_type_hints

import yaml

from spgf_torch.paths import root

_KEY = re.compile(r"^(?P<indent> *)(?P<key>[\w.]+):(?P<rest>.*)$")
_HIDDEN = {"defaults", "hydra"}


@dataclass(frozen=True)
class Key:
    """A key of a YAML file: dotted name, default as YAML has it (None of a mapping), and the comment beside it."""

    name: str
    default: str | None
    reason: str


@dataclass(frozen=True)
class SettingsFile:
    """A YAML file of settings: what its first comment says, the groups that it composes, and its keys."""

    about: str
    groups: dict[str, str]
    keys: list[Key]


def read_settings(path: Path) -> SettingsFile:
    """Keys, defaults and reasons of a file of conf/; a comment that goes on in the next line belongs to its key."""
    head: list[str] = []
    keys: list[Key] = []
    stack: list[tuple[int, str]] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        found = _KEY.match(line)
        if found is None:
            words = line.strip().removeprefix("#").strip()
            if line.strip().startswith("#") and not words.startswith("@package"):
                if keys and line.startswith(" "):
                    last = keys[-1]
                    keys[-1] = Key(last.name, last.default, f"{last.reason}\n{words}".strip())
                elif not keys:
                    head.append(words)
            continue
        indent = len(found["indent"])
        stack = [(depth, name) for depth, name in stack if depth < indent]
        value, reason = _split_comment(found["rest"])
        stack.append((indent, found["key"]))
        keys.append(Key(".".join(name for _, name in stack), value or None, reason))
    groups = _groups(path)
    shown = [key for key in keys if key.name.split(".")[0] not in _HIDDEN]
    return SettingsFile("\n".join(head).strip(), groups, _with_inherited(path, shown))


def _with_inherited(path: Path, own: list[Key]) -> list[Key]:
    """The keys of a group's file: those of the file that it starts from, in its order, as it changes them, and more."""
    entries = (yaml.safe_load(path.read_text(encoding="utf-8")) or {}).get("defaults", [])
    names = [entry for entry in entries if isinstance(entry, str) and path.parent != root() / "conf"]
    before = [path.parent / f"{name}.yaml" for name in names]
    keys = {key.name: key for base in before if base.is_file() for key in read_settings(base).keys}
    for key in own:
        reason = key.reason or (keys[key.name].reason if key.name in keys else "")
        keys[key.name] = Key(key.name, key.default, reason)
    return list(keys.values())


def _split_comment(rest: str) -> tuple[str, str]:
    """The value of a line of YAML, and its comment."""
    found = re.search(r"(?:^|\s)#\s?(.*)$", rest)
    return (rest.strip(), "") if found is None else (rest[: found.start()].strip(), found[1].strip())


def _groups(path: Path) -> dict[str, str]:
    """What `defaults:` composes: group -> file; Hydra's own and `command` are left out."""
    entries = (yaml.safe_load(path.read_text(encoding="utf-8")) or {}).get("defaults", [])
    named = [(str(key), str(value)) for entry in entries if isinstance(entry, dict) for key, value in entry.items()]
    return {key: value for key, value in named if not key.startswith(("override ", "hydra"))}


def limits(kind: type, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Each dotted key of a settings dataclass with its range or its choices, in words."""
    types = get_type_hints(kind)
    for entry in fields(kind):
        inner = types[entry.name]
        if isinstance(inner, type) and is_dataclass(inner):
            yield from limits(inner, f"{prefix}{entry.name}.")
        elif "range" in entry.metadata:
            low, high = entry.metadata["range"]
            whole = "" if float in (inner, *get_args(inner)) else "whole number, "
            yield prefix + entry.name, f"{whole}{_number(low)} to {_number(high)}"
        elif "choice" in entry.metadata:
            yield prefix + entry.name, ", ".join(f"`{word}`" for word in entry.metadata["choice"])
        elif inner is bool:
            yield prefix + entry.name, "`true`, `false`"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value == int(value) else f"{value:g}"
