"""Translate a command's arguments so that Hydra reads them as they were meant; errors are one line.

Hydra's grammar gives a meaning to blanks, commas, quotes, brackets and `$`. In a setting that is a path they have
none: any name that the shell passes is taken as it is, also in lists. Other settings are left to the grammar.
"""

from __future__ import annotations

import difflib
import io
import re
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_type_hints

from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Glob, Override, Quote, QuotedString, RangeSweep
from hydra.errors import HydraException

from spgf_torch.cli.hand_files import GROUP, option_of, proposed
from spgf_torch.errors import InputError
from spgf_torch.files.reading import reason
from spgf_torch.hands.description_file import is_file_name
from spgf_torch.paths import root

# Settings that name files or folders, in any command.
_SCENE = {"input", "model", "intrinsics", "poses", "mask", "segments"}
_FOLDERS = {
    "objects",
    "trials",
    "own_trials",
    "runs",
    "out",
    "export",
    "checkpoints",
    "cache",
    "baseline",
    "judge",
    "ranges",
    "cgn",
    "beside",
}
PATHS = _SCENE | _FOLDERS | {"prototypes_from", "hand.urdf", "urdf", "hydra.run.dir", "hydra.sweep.dir"}
# Of these, what may hold numbers instead.
NUMBERS = frozenset(["intrinsics", "poses"])
# What a command is about: where a word without a key belongs.
SUBJECT = {
    "predict": "input",
    "view": "input",
    "report": "runs",
    "compare": "runs",
    "export": "format",
    "baseline": "export",
    "hand": "hand",
}
# Keys that are not Python names, or not theirs: as users give them, and as the settings have them.
ALIASES = {"as": "read_as"}
# A quoted element of a list, with the blanks around it.
_ELEMENT_IN_QUOTES = re.compile(r"""\s*(?:'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")\s*(?=,|$)""", re.DOTALL)
MOST_COMMAS = 20  # pieces between commas that may belong to the name of one file
# Names that users look for and no setting has.
ELSEWHERE = {
    **dict.fromkeys(["output", "folder", "dir"], "out=FOLDER names the folder of the run"),
    "top": "N=COUNT is how many of each type",
}


def translated(command: str, kind: type, arguments: Sequence[str]) -> list[str]:
    """The arguments for Hydra: options first, then overrides, whose paths are quoted.

    Raises InputError for an unknown option or key, a word without a key, and a value that Hydra's grammar refuses.
    """
    ordered = sorted(arguments, key=_is_override)  # argparse wants all overrides together
    words, sweep = _overrides(command, ordered)
    known = dict(known_settings(kind, ""))
    options = list(ordered)
    for word in words:
        options.remove(word)
    return [*options, *(_override(command, word, known, sweep) for word in words)]


def _is_override(argument: str) -> bool:
    return "=" in argument and not argument.startswith("-")


def _overrides(command: str, arguments: Sequence[str]) -> tuple[list[str], bool]:
    """What is no option of Hydra's, and whether it is a sweep (-m)."""
    said = io.StringIO()
    try:
        with redirect_stderr(said), redirect_stdout(said):
            options, unknown = get_args_parser().parse_known_args(list(arguments))
    except SystemExit:
        line = said.getvalue().strip().splitlines()[-1].partition("error: ")[2]
        raise InputError(f"{line}; settings are given as key=value, {_example(command)}") from None
    if unknown:
        name, _, value = unknown[0].lstrip("-").partition("=")
        value = value or next(iter(options.overrides), "VALUE")
        raise InputError(f"{unknown[0]}: expected a setting as key=value, such as {name}={value}; got an option")
    return options.overrides, options.multirun


def _override(command: str, word: str, known: dict[str, Any], sweep: bool) -> str:
    """One override as Hydra shall read it."""
    key, equals, value = word.partition("=")
    prefix = key[: len(key) - len(key.lstrip("+~"))]
    name = key[len(prefix) :]
    if not equals:
        if prefix == "~" and (name in known or in_mapping(name, known)):
            return word
        raise InputError(f"{word}: expected a setting as key=value, {_example(command, word)}; got no key")
    if ALIASES.get(name) in known:
        name = ALIASES[name]
    _check_key(command, name, known)
    prefix = "++" if not prefix and name not in known and in_mapping(name, known) else prefix  # new keys, too
    if name == GROUP and prefix != "~" and is_file_name(value):
        name, value = _hand(command, value, sweep)
    if name in PATHS and known.get(name) is not int and prefix != "~":
        read = _paths(name, value, sweep)
        return f"{prefix}{name}={read if name.startswith('hydra.') else _literal(read)}"
    result = f"{prefix}{name}={value}"
    _check_grammar(command, name, result, value, sweep)
    return result


def _example(command: str, value: str = "FILE") -> str:
    subject = SUBJECT.get(command, "objects")
    return f"such as {subject}={value}"


def _hand(command: str, value: str, sweep: bool) -> tuple[str, str]:
    """Key and value for `hand=FILE`: an option of the group, several of a sweep, or the URDF to describe."""
    whole = _unquoted(value)
    if proposed(command, whole):
        return "urdf", whole
    parts = [whole] if exists(whole) or not sweep else _split(value)
    return GROUP, ",".join(option_of(part) if is_file_name(part) else part for part in parts)


# Keys


def known_settings(kind: type, prefix: str) -> Iterator[tuple[str, Any]]:
    """Every key of the settings, dotted, with its type."""
    types = get_type_hints(kind)
    for entry in fields(kind):
        inner = types[entry.name]
        yield prefix + entry.name, inner
        if isinstance(inner, type) and is_dataclass(inner):
            yield from known_settings(inner, f"{prefix}{entry.name}.")


def in_mapping(name: str, known: dict[str, Any]) -> bool:
    """Whether a key is within a mapping of any keys, such as the joints of a hand."""
    outer = [name[: dot.start()] for dot in re.finditer(r"\.", name)]
    return any(place in known and not is_dataclass(known[place]) for place in outer)


def _check_key(command: str, name: str, known: dict[str, Any]) -> None:
    """InputError for a key that the command has not; groups of conf/ and Hydra's own are keys as well."""
    bare = re.split("[@:]", name)[0]
    if bare in known or in_mapping(bare, known) or re.match(r"hydra[./]|hydra$", bare):
        return
    if bare and (root() / "conf" / bare).is_dir():
        return
    hint = ELSEWHERE.get(bare) or _meant(bare, known)
    words = f"{bare}: expected a setting of {command}" if bare else "=: expected a key before it"
    raise InputError(f"{words} (see --help), got an unknown key{f'; {hint}' if hint else ''}")


def _meant(name: str, known: dict[str, Any]) -> str:
    """`did you mean N?` for a name close to a known one, whole or without its room."""
    shown = {internal: alias for alias, internal in ALIASES.items()}
    full = {shown.get(key, key): key for key in known}
    found = difflib.get_close_matches(name.lower(), [key.lower() for key in full], n=2, cutoff=0.7)
    whole = [key for key in full if key.lower() in found]
    leaf = [key for key in full if key.rpartition(".")[2].lower() == name.rpartition(".")[2].lower()]
    meant = list(dict.fromkeys([*leaf, *whole]))[:3]
    return f"did you mean {' or '.join(meant)}?" if meant else ""


def _check_grammar(command: str, name: str, override: str, value: str, sweep: bool) -> None:
    try:
        parsed = OverridesParser.create().parse_rule(override, "override")
    except (HydraException, ValueError, RecursionError) as error:
        if isinstance(error, HydraException):
            quoted = QuotedString(value, Quote.single).with_quotes()
            got = f'{value}; text with blanks, commas, brackets or quotes goes in quotes: "{name}={quoted}"'
        else:
            got = reason(error)
        raise InputError(f"{name}: expected a value that Hydra can read, got {got}") from None
    if isinstance(parsed, Override) and parsed.is_sweep_override() and not sweep:
        raise InputError(f"{name}: expected one value, or a list {name}=[{value}], or -m to try each; got {value}")
    if isinstance(parsed, Override) and _has_no_value(name, parsed):
        raise InputError(f"{name}: expected at least one value to try, got none in {value}")


def _has_no_value(name: str, sweep: Override) -> bool:
    """Whether a range is empty, or no option of a group has a name that is asked for: Hydra would run no job."""
    wanted = sweep.value()
    if isinstance(wanted, RangeSweep):
        return wanted.step == 0 or next(iter(wanted.range()), None) is None
    options = [path.stem for path in (root() / "conf" / re.split("[@:]", name)[0]).glob("*.yaml")]
    return isinstance(wanted, Glob) and not wanted.filter(options)


# Paths


def _paths(name: str, value: str, sweep: bool) -> str:
    """The value of a setting that is a path, or a list of paths, in Hydra's grammar."""
    if exists(value):
        return _quoted(value)
    if value in ("null", "???"):
        return value
    if sweep and (several := _sweep(name, value)):
        return several
    if value.startswith("[") and value.endswith("]"):
        return _list(name, value)
    if "," in value and not sweep:
        parts = _split(value)
        if (name in NUMBERS and all(map(is_number, parts))) or all(map(exists, parts)):
            raise InputError(f"{name}: expected a list in brackets, {name}=[{value}]; got {value}")
    return _quoted(_unquoted(value))


def _sweep(name: str, value: str) -> str:
    """A sweep over paths: `a,b` or a function of Hydra's; empty where the value is none."""
    if re.fullmatch(r"(choice|glob|range|interval|sort|shuffle|tag|str)\(.*\)", value, re.DOTALL):
        return value
    if value.startswith("[") and value.endswith("]"):
        depth, parts, start = 0, [], 0
        for i, c in enumerate(value):
            depth += (c == "[") - (c == "]")
            if c == "," and depth == 0:
                parts.append(value[start:i])
                start = i + 1
        parts.append(value[start:])
    else:
        parts = _split(value)
    return ",".join(_paths(name, part, False) for part in parts) if len(parts) > 1 else ""


def _list(name: str, value: str) -> str:
    parts = _split(value[1:-1])
    if name in NUMBERS and not any(map(exists, parts)) and _holds_numbers(value):
        return value
    return "[" + ",".join(_quoted(_unquoted(part)) for part in parts if part) + "]"


def _holds_numbers(value: str) -> bool:
    return re.fullmatch(r"[\[\]\s,\d.+\-eE]*\d[\[\]\s,\d.+\-eE]*", value) is not None


def _split(inner: str) -> list[str]:
    """The elements of a list without its brackets: at commas, but not within quotes, nor within the name of a file."""
    tokens, at = [], 0
    while at <= len(inner):
        quoted = _ELEMENT_IN_QUOTES.match(inner, at)
        comma = quoted.end() if quoted else inner.find(",", at)
        end = len(inner) if comma < 0 else comma
        tokens.append(inner[at:end])
        at = end + 1
    found: list[str] = []
    while tokens:
        # The shortest run of pieces that is the name of a file; names that do not exist end at the comma.
        runs = [",".join(tokens[:n]) for n in range(1, min(len(tokens), MOST_COMMAS) + 1)]
        count, name = next(
            ((n, form) for n, run in enumerate(runs, 1) for form in _forms(run) if exists(form)),
            (1, tokens[0].strip()),
        )
        tokens = tokens[count:]
        found.append(name)
    return found


def _forms(piece: str) -> tuple[str, ...]:
    """What a piece of a list may mean: blanks belong to the name, or the first to the comma before it, or none does."""
    return piece, piece.removeprefix(" "), piece.strip()


def _quotes(piece: str) -> bool:
    bare = piece.strip()
    return len(bare) > 1 and bare[0] == bare[-1] and bare[0] in "'\""


def _unquoted(value: str) -> str:
    """Without the quotes of Hydra's grammar around it, unless a file is called so."""
    bare = value.strip()
    if not _quotes(value) or exists(value):
        return value
    if exists(bare[1:-1]) or re.search(rf"(?<!\\){bare[0]}", bare[1:-1]):
        return bare[1:-1]
    return re.sub(r"\\(['\"\\])", r"\1", bare[1:-1])


def _quoted(path: str) -> str:
    """A path as text of Hydra's grammar, whatever characters it has; `~` is the home folder, or a file of that name."""
    if path.startswith("~"):
        with suppress(RuntimeError):  # ~user of an unknown user
            path = f"./{path}" if exists(path) else str(Path(path).expanduser())
    if path == "???":  # OmegaConf's word for a value that is missing
        path = "./???"
    return QuotedString(path, Quote.single).with_quotes()


def _literal(path: str) -> str:
    """With `${` such that OmegaConf does not look for a value of that name."""
    return re.sub(r"(\\*)\$\{", lambda found: found[1] * 2 + "\\${", path)


def exists(path: str) -> bool:
    try:
        return bool(path) and Path(path).exists()
    except (OSError, ValueError):  # longer than a path may be; a NUL
        return False


def is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
