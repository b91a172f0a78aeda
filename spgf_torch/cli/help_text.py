"""`--help` of a command: what it does, its options, each setting with default, values, meaning and unit of conf/."""

from __future__ import annotations

import re
import shutil
import textwrap
from collections.abc import Iterator, Mapping

import yaml

from spgf_torch.cli.command_line import ALIASES, SUBJECT, known_settings
from spgf_torch.cli.setting_comments import Key, limits, read_settings
from spgf_torch.paths import root

# Characters of a line in a terminal that is wider; of a default that is shown; blanks before what a setting means.
WIDEST, LONGEST, INDENT = 110, 40, 6

# What commands understand beside their settings.
OPTIONS = {
    "--out DIR": "folder of the run, new or empty; without it outputs/{command}/DATE-TIME, and latest beside it",
    "--json": "one JSON object on stdout (folders, results, status); all else goes to stderr",
    "-m, --multirun": "try several values: key=a,b",
    "--cfg job": "print the settings that a run would have",
    "--version": "print the version",
}


def help_text(command: str, kind: type) -> str:
    """The help of a command whose settings are of the dataclass `kind`."""
    own = read_settings(root() / "conf" / f"{command}.yaml")
    known, ranges = dict(known_settings(kind, "")), dict(limits(kind))
    words = _of_hydra(command)
    subject = SUBJECT.get(command, "objects")
    more = f" [{subject.upper()} ...]" if subject in known else ""
    lines = [f"spgf {command}{more} [--setting VALUE | setting=VALUE ...]", "", *words["header"], "", "Options:"]
    options = dict(OPTIONS)
    if "out" in known:
        del options["--out DIR"]
    if "hand" not in known and "model" in known:
        options = {"--hand NAME": "the hand whose shipped model is asked, instead of --model FOLDER", **options}
    for name, meaning in options.items():
        lines += _entry(name, "", meaning.format(command=command))
    lines += ["", "Settings:", *_settings(own.keys, "", ranges)]
    for group, name in own.groups.items():
        lines += _group(group, name, {key.name for key in own.keys}, ranges)
    return "\n".join([*lines, "", *words["footer"], "Exit status: docs/howto/command.md."])


def _of_hydra(command: str) -> dict[str, list[str]]:
    """What conf/ says above and below the settings, without the lines that tell how to call the command."""
    content = yaml.safe_load((root() / "conf" / f"{command}.yaml").read_text(encoding="utf-8"))["hydra"]["help"]
    return {
        part: [line for line in content[part].splitlines() if not line.startswith("python -m")]
        for part in ("header", "footer")
    }


def _group(group: str, name: str, taken: set[str], ranges: Mapping[str, str]) -> Iterator[str]:
    """The settings that a group of conf/ brings; of a hand where its keys are told."""
    here, bare = group.endswith("@_here_"), group.split("@")[0]
    names = sorted(path.stem for path in (root() / "conf" / bare).glob("*.yaml"))
    yield ""
    if bare == "hand":
        yield f"hand, --hand NAME or FILE.yaml: {', '.join(names)} [{name}]"
        yield "  Its keys, --hand.KEY, are told in docs/howto/hand.md."
        return
    others = f": {', '.join(names)} [{name}]" if len(names) > 1 else ":"
    yield f"{bare}{'' if here else f', --{bare} NAME'}{others}"
    keys = read_settings(root() / "conf" / bare / f"{name}.yaml").keys
    yield from _settings([key for key in keys if not (here and key.name in taken)], "" if here else f"{bare}.", ranges)


def _settings(keys: list[Key], prefix: str, ranges: Mapping[str, str]) -> Iterator[str]:
    shown = {internal: alias for alias, internal in ALIASES.items()}
    for key in keys:
        if key.default is None and not key.reason:
            continue  # a mapping: its keys have lines of their own
        name = prefix + shown.get(key.name, key.name)
        default = "required" if key.default == "???" else (key.default or "")
        default = default if len(default) <= LONGEST else default[: LONGEST - 3] + "..."
        values = re.sub("`", "", ranges.get(prefix + key.name, ""))
        yield from _entry(f"--{name}", f"[{default}]" + (f"  {values}" if values else ""), key.reason)


def _entry(name: str, values: str, meaning: str) -> list[str]:
    """An option with its values, and below it what it means."""
    width = min(shutil.get_terminal_size().columns, WIDEST)
    blanks = " " * INDENT
    words = textwrap.wrap(meaning, width, initial_indent=blanks, subsequent_indent=blanks, break_long_words=False)
    return [f"  {name}  {values}".rstrip(), *words]
