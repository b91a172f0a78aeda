"""Arguments as shells are used to, `mug.ply --viewpoint 0 0 0`, as the overrides that Hydra reads.

Both forms may be mixed. An option is called as its setting, or by its singular; a word without a key is what the
command is about; `out` and `hand` name a folder and a model where the settings of a command have no such key.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from difflib import get_close_matches
from itertools import takewhile
from typing import Any, get_args

from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Quote, QuotedString
from hydra.errors import HydraException

from spgf_torch.cli.command_line import (
    ALIASES,
    ELSEWHERE,
    PATHS,
    SUBJECT,
    exists,
    in_mapping,
    is_number,
    known_settings,
)
from spgf_torch.errors import InputError
from spgf_torch.files.given_paths import model_of_hand
from spgf_torch.paths import root

SCALARS = {int, float, str, bool}
# Settings that are so many numbers in a row, `--viewpoint 0 0 0`, and the words that some take instead.
VECTORS: dict[str, tuple[int, tuple[str, ...]]] = {
    "viewpoints": (3, ()),
    "crop_low": (3, ()),
    "crop_high": (3, ()),
    "gravity": (3, ("auto",)),
    "table": (4, ("find",)),
}
# Setting that makes each of several files a run of its own, of commands that have it.
BATCH = "batch"


def as_overrides(command: str, kind: type, arguments: Sequence[str]) -> list[str]:
    """The arguments with each option and each word without a key as `key=value`; Hydra's own options stay.

    Raises InputError for an option that neither the command nor Hydra has, or that lacks its value.
    """
    known = dict(known_settings(kind, ""))
    words = deque(arguments)
    rest: list[str] = []
    files: list[str] = []
    given: dict[str, list[str]] = {}
    while words:
        word = words.popleft()
        if word == "--":
            files += words
            break
        if (takes := _of_hydra(word)) is not None:
            rest += [word, *(words.popleft() for _ in range(min(takes, len(words))))]
        elif word.startswith("-") and len(word) > 1 and not exists(word):
            name, values = _option(command, word, words, known)
            given.setdefault(name, []).extend(values)
        elif not word or _is_override(word, known):
            rest.append(word)
        else:
            files.append(word)
    subject = SUBJECT.get(command, "objects")
    if files and subject not in known:
        return [*rest, *files]  # refused as words without a key
    if files:
        given.setdefault(subject, []).extend(files)
    _check_once(given, rest)
    batch = [f"{BATCH}=true"] if len(files) > 1 and BATCH in known else []
    overrides = [*rest, *(_joined(name, values, known) for name, values in given.items()), *batch]
    sweep = bool({"-m", "--multirun"} & set(rest))
    return _elsewhere(overrides, known, sweep)


def _check_once(given: dict[str, list[str]], rest: Sequence[str]) -> None:
    """InputError for a setting that an option, or a word without a key, gives and `key=value` too."""
    for word in rest:
        key, equals, _ = word.partition("=")
        if equals and (values := given.get(key.lstrip("+"))):
            raise InputError(f"{key}: expected one value, got {' and '.join(values)}, and {word}")


def _of_hydra(word: str) -> int | None:
    """How many words follow an option of Hydra's; None of any other word."""
    action = get_args_parser()._option_string_actions.get(word)
    return None if action is None else 0 if action.nargs == 0 else 1


def _is_override(word: str, known: dict[str, Any]) -> bool:
    """`key=value`, or `~key`; a file whose name has `=` in it, and begins with no key, is none."""
    key = word.partition("=")[0].lstrip("+~")
    if word.startswith("~") and (key in known or in_mapping(key, known)):
        return True
    return "=" in word and (key in known or not exists(word))


def _option(command: str, word: str, words: deque[str], known: dict[str, Any]) -> tuple[str, list[str]]:
    """The setting that an option names, and its value; what follows is taken from `words`."""
    bare, equals, value = word.lstrip("-").partition("=")
    off = bare.removeprefix("no-").replace("-", "_")
    if bare.startswith("no-") and known.get(off) is bool and not equals:
        return off, ["false"]
    name = _setting(command, word.partition("=")[0], bare, known)
    if equals:
        return name, [value]
    if known.get(name) is bool and not (words and words[0] in ("true", "false")):
        return name, ["true"]
    if not words or (words[0].startswith("-") and len(words[0]) > 1 and not is_number(words[0])):
        raise InputError(f"{word}: expected a value after it, got {words[0] if words else 'none'}")
    first = words.popleft()
    values = first.split(",") if name in VECTORS and all(map(is_number, first.split(","))) else [first]
    while is_number(values[0]) and not _is_scalar(known.get(name)) and words and is_number(words[0]):
        values.append(words.popleft())
    if name in VECTORS and not _is_scalar(known.get(name)):
        _check_vector(word, name, values, words)
    return name, ["[" + ",".join(values) + "]"] if len(values) > 1 else values


def _check_vector(word: str, name: str, values: Sequence[str], after: Sequence[str]) -> None:
    """InputError for a row of numbers that is none, before its words are taken for files.

    What has a bracket or a comma is left to Hydra's grammar.
    """
    count, others = VECTORS[name]
    words = ("null", *others)
    if values[0] in words or set("[(,") & set(values[0]) or (is_number(values[0]) and len(values) == count):
        return
    said = [*values, *takewhile(lambda each: not each.startswith("--"), after)]
    got = said[: max(count, len(values))]
    instead = "".join(f", or {each}" for each in others)
    raise InputError(f"{word}: expected {count} numbers after it{instead}; got {' '.join(got)}")


def _is_scalar(kind: Any) -> bool:
    return kind in SCALARS or bool(SCALARS & set(get_args(kind)))


def _setting(command: str, word: str, name: str, known: dict[str, Any]) -> str:
    """The key that an option means: it, its plural, a group of conf/, or `out` and `hand`, which stand elsewhere."""
    bare = name.replace("-", "_")
    for key in (name, bare, f"{bare}s", ALIASES.get(bare, "")):
        if key in known or in_mapping(key, known):
            return key
    if bare in _pseudo(known) or name.startswith("hydra."):
        return name
    if bare and (root() / "conf" / bare).is_dir():
        return f"+{bare}"  # a group that the command's own settings do not begin with
    options = [key.replace("_", "-") for key in (*known, *ALIASES, *_pseudo(known))]
    near = get_close_matches(bare.replace("_", "-"), options, 1, 0.7)
    hint = f"; did you mean --{near[0]}?" if near else f"; {ELSEWHERE[bare]}" if bare in ELSEWHERE else ""
    raise InputError(f"{word}: expected an option of {command} (see --help), got an unknown one{hint}")


def _pseudo(known: dict[str, Any]) -> list[str]:
    """Names that a command understands beside its settings."""
    hand = ["hand"] if "hand" not in known and "model" in known else []
    return [*([] if "out" in known else ["out"]), *hand]


def _joined(name: str, values: list[str], known: dict[str, Any]) -> str:
    """The override of an option that was given once, or more often: a list."""
    if len(values) > 1:
        if _is_scalar(known.get(name, str)):
            raise InputError(f"{name}: expected one value, got {' and '.join(values)}")
        parts = [_quoted(value) for value in values] if name in PATHS else values
        return f"{name}=[{','.join(parts)}]"
    return f"{name}={values[0]}" if name in PATHS or _is_readable(name, values[0]) else f"{name}={_quoted(values[0])}"


def _quoted(value: str) -> str:
    return str(QuotedString(value, Quote.single).with_quotes())


def _is_readable(name: str, value: str) -> bool:
    """Whether Hydra's grammar can read a value as the shell passed it."""
    try:
        OverridesParser.create().parse_rule(f"{name}={value}", "override")
    except (HydraException, ValueError, RecursionError):
        return False
    return True


def _elsewhere(overrides: list[str], known: dict[str, Any], sweep: bool) -> list[str]:
    """`out=` and `hand=` as what they stand for, where the settings have no such key."""
    pseudo, result = _pseudo(known), []
    keys = {word.partition("=")[0] for word in overrides}
    for word in overrides:
        key, equals, value = word.partition("=")
        if key not in pseudo or not equals:
            result.append(word)
        elif key == "out":
            result.append(f"hydra.{'sweep' if sweep else 'run'}.dir={value}")
        elif "model" in keys:
            raise InputError("hand: expected hand=NAME for its shipped model, or model=FOLDER; got both")
        else:
            result.append(f"model={model_of_hand(value)}")
    return result
