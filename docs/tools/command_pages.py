"""One page a command, made from its settings: every key with its default, its range and the reason beside it in conf/.

The YAML files in conf/ hold defaults and reasons (their comments); the dataclasses hold types, ranges and choices.
Nothing is written twice, so the pages cannot differ from what the command does.
"""

from __future__ import annotations

import importlib.util
import runpy
from collections.abc import Iterator, Mapping
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints
from unittest.mock import patch

import yaml

from spgf_torch.__main__ import COMMANDS
from spgf_torch.cli import command as cli
from spgf_torch.cli.command_line import ALIASES
from spgf_torch.cli.setting_comments import Key, SettingsFile, limits, read_settings

CONF = Path(__file__).parents[2] / "conf"
_LONGEST = 60  # characters of a default that a table shows


@cache
def kind_of(command: str) -> type:
    """The dataclass of a command's settings: what its module hands to `cli.run_command`."""
    found: list[type] = []
    module = importlib.util.find_spec(f"spgf_torch.{command}")
    assert module is not None and module.origin is not None
    with patch.object(cli, "run_command", lambda command, kind, run: found.append(kind)):
        runpy.run_path(module.origin, run_name="__main__")
    return found[0]


def command_page(command: str) -> str:
    """The Markdown page of a command."""
    own = read_settings(CONF / f"{command}.yaml")
    known = dict(limits(kind_of(command)))
    about = importlib.import_module(f"spgf_torch.{command}").__doc__ or ""
    lines = [f"# {command}", "", _as_text(about), "", "```", *_example(command), "```", ""]
    lines += [f"Settings of the command itself, from `conf/{command}.yaml`. `key=value` changes one.", ""]
    lines += [*_table(own.keys, "", known), ""]
    for group, name in own.groups.items():
        here = group.endswith("@_here_")
        bare = group.split("@")[0]
        part = read_settings(CONF / bare / f"{name}.yaml")
        taken = {key.name for key in own.keys} if here else set()
        others = sorted(path.stem for path in (CONF / bare).glob("*.yaml") if path.stem != name)
        lines += [f"## {bare}", ""]
        lines += ["Keys of the command, without a prefix." if here else f"Prefix: `{bare}.`", ""]
        lines += [f"From `conf/{bare}/{name}.yaml`{_choices(bare, others)}.", ""]
        lines += [_as_text(part.about), ""] if part.about else []
        keys = [key for key in part.keys if key.name not in taken]
        lines += [*_table([*keys, *_others(command, bare, part)], "" if here else f"{bare}.", known), ""]
    return "\n".join(lines)


def _others(command: str, group: str, part: SettingsFile) -> list[Key]:
    """Keys of a hand that this one does without: what each means is told once, for all hands."""
    if group != "hand":
        return []
    there = {key.name.split(".")[0] for key in part.keys}
    (hand,) = (kind for name, kind in get_type_hints(kind_of(command)).items() if name == group)
    return [Key(entry.name, None, "docs/howto/hand.md") for entry in fields(hand) if entry.name not in there]


def _choices(group: str, others: list[str]) -> str:
    return f"; others: {', '.join(f'`{group}={name}`' for name in others)}" if others else ""


def _example(command: str) -> list[str]:
    """The lines of the help's header that are commands, or the bare command."""
    header = _yaml(CONF / f"{command}.yaml")["hydra"]["help"]["header"]
    return [line for line in header.splitlines() if line.startswith("python -m")] or [f"python -m spgf_torch.{command}"]


def _yaml(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    return content


def _table(keys: list[Key], prefix: str, known: Mapping[str, str]) -> list[str]:
    """Key, default, range and reason: a row a key. A mapping has no row, but for what its comment says."""
    shown = {internal: alias for alias, internal in ALIASES.items()}
    inner = {key.name.rpartition(".")[0] for key in keys}
    rows = ["| key | default | values | reason |", "|---|---|---|---|"]
    for key in keys:
        if key.default is None and key.name in inner and not key.reason:
            continue
        name = f"`{prefix}{key.name}`" + (f" or `{shown[key.name]}`" if key.name in shown else "")
        rows.append(f"| {name} | {_default(key)} | {known.get(prefix + key.name, '')} | {_cell(key.reason)} |")
    return rows


def _default(key: Key) -> str:
    value = key.default
    if value is None or (value == "???" and "without it" in key.reason):
        return ""
    if value == "???":
        return "required"
    return f"`{_cell(value if len(value) <= _LONGEST else value[: _LONGEST - 3] + '...')}`"


def _cell(words: str) -> str:
    """Text for a cell of a table: upright bars, angle brackets and asterisks are no markup."""
    return words.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*").replace("\n", "<br>")


def _as_text(docstring: str) -> str:
    return docstring.replace("<", "&lt;").strip()


def pages() -> Iterator[tuple[str, str]]:
    """Every command with its page, and `index` with the list of them."""
    rows = [f"| [`{name}`]({name}.md) | {_cell(words)} |" for name, words in COMMANDS.items()]
    head = "# Commands\n\n`python -m spgf_torch.COMMAND key=value ...`. " + _HOW
    yield "index", "\n".join([head, "", "| command | does |", "|---|---|", *rows, ""])
    for name in COMMANDS:
        yield name, command_page(name)


_HOW = (
    "`--help` prints the settings in a terminal, `--cfg job` those of a run, `-m` tries several values. "
    "These pages are made from `conf/` and the settings' classes: defaults, ranges and reasons are the program's own."
)
