"""Check that the files which the settings name exist, before imports that take seconds."""

from __future__ import annotations

import re
from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from spgf_torch.errors import InputError
from spgf_torch.files.reading import existing
from spgf_torch.paths import find, root

MODEL, JUDGE = ("model.json", "model.safetensors"), ("judge.json", "judge.safetensors")
# Where models have names: the user's own in the working folder, and those of the package, called as their hands.
OWN, SHIPPED = "models", "data/models"
# In the place of a folder: no model, no judge; what `train` did last, which is never meant unless it is said.
NONE, LATEST = "none", "latest"
TRAINED = "outputs/train/latest"


def check_files(config: Any, needed: str, *others: str) -> None:
    """InputError for the first file of these settings, one or a list each, that is missing, empty or a folder.

    One at least must be `needed`; others that the config has not, that are null or hold numbers are left to who reads
    them.
    """
    if not list(_words(getattr(config, needed))):
        raise InputError(f"{needed}: expected a file or a list of files ({needed}=FILE), got none")
    for name in (needed, *others):
        for path in _words(getattr(config, name, None)):
            existing(find(path))


def check_folder(name: str, path: str, what: str) -> None:
    """InputError unless `path`, the setting `name`, is a folder with something in it."""
    folder = find(path)
    try:
        got = "a file" if folder.is_file() else "nothing there" if not folder.is_dir() else ""
        got = got or ("" if any(folder.iterdir()) else "an empty folder")
    except (OSError, ValueError) as error:
        got = str(getattr(error, "strerror", None) or error)
    if got:
        raise InputError(f"{name}: expected {what}, got {got} at {path}")


def check_model(name: str, path: str) -> None:
    """InputError unless `path`, the setting `name`, is a folder with a model of all objects, as far as names tell."""
    expected = "the folder of a model that train left (final_model=true, the default, keeps one)"
    if not path:
        raise InputError(f"{name}: expected {expected}, got no name")
    folder = model_folder(path, name)
    check_folder(name, str(folder), expected)
    if missing := [each for each in MODEL if not (folder / each).is_file()]:
        got = "a judge alone" if _any_of(JUDGE, folder) and len(missing) == len(MODEL) else f"no {missing[0]}"
        raise InputError(f"{name}: expected {expected}, got {got} at {path}")


def known_models() -> dict[str, Path]:
    """Name -> folder of every model that has a name, a shipped one's before a user's own of the same name."""
    rooms = [folder for place in (Path(OWN), root() / SHIPPED) if place.is_dir() for folder in sorted(place.iterdir())]
    return {folder.name: folder for folder in rooms if _any_of((*MODEL, *JUDGE), folder)}


def model_folder(given: str | Path | None, key: str = "model") -> Path:
    """The folder that a setting `key` means: a path (with a slash, or a Path), a name, or `latest`.

    Raises InputError where nothing is given, for a name that no model has, and for one that may mean two folders.
    """
    if given is None or not str(given):
        raise InputError(
            f"{key}: expected hand=NAME for a shipped model ({', '.join(_shipped())}), {key}=NAME or {key}=FOLDER, "
            f"or {key}={LATEST} for what train did last; got none"
        )
    if not isinstance(given, str | Path):
        raise InputError(f"{key}: expected the name of a model or a folder, got {given!r:.40}")
    if given == LATEST:
        return find(TRAINED)
    folder, word = find(given), str(given)
    if isinstance(given, Path) or "/" in word:
        return folder
    known = known_models()
    if word not in known:
        if folder.is_dir():
            return folder
        near = get_close_matches(word, [*known, LATEST], 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise InputError(f"{key}: expected a model ({', '.join(known)}), {LATEST} or a folder, got {word}{hint}")
    for other, path in ((folder, f"./{word}"), (Path(OWN) / word, f"{OWN}/{word}")):
        if _any_of((*MODEL, *JUDGE), other) and other.resolve() != known[word].resolve():
            raise InputError(f"{key}: expected one model, got two: {path} and {known[word]}; {key}={path} is the first")
    return known[word]


def model_and_judge(model: str | Path | None, judge: str | Path | None) -> tuple[Path | None, Path | None]:
    """The folders of the votes' model and of the judge that ranks; one of them may be None.

    Args:
        model: what `train` left, with a judge in it or without; a folder of a judge alone; `none`. A name, as
            `model_folder` takes it, stands for its folder.
        judge: a judge's folder; None: the one in the folder `model`, if there is one; `none`: the votes rank.

    Raises InputError where there is neither, or a folder does not hold what it should, as far as names tell.
    """
    folder = None if model == NONE else model_folder(model)
    carries = folder is not None and _any_of(JUDGE, folder)
    votes = None if folder is None or (carries and not _any_of(MODEL, folder)) else folder
    ranks = folder if carries else None
    if judge is not None:
        ranks = None if judge == NONE else model_folder(judge, "judge")
    if ranks is None and votes is None:
        raise InputError(f"judge: expected a judge's folder where model={model} has no votes that could rank, got none")
    for name in JUDGE if ranks is not None else ():
        if not (ranks / name).is_file():  # type: ignore[operator]
            raise InputError(
                f"judge: expected a folder that python -m spgf_torch.judge left, found no {name} in {ranks}"
            )
    for name in MODEL if votes is not None else ():
        if not (votes / name).is_file():  # type: ignore[operator]
            hint = "" if ranks is None else "; model=none takes the judge alone"
            raise InputError(f"{votes}/{name}: expected a model that train left (make train), found no such file{hint}")
    return votes, ranks


def model_of_hand(hand: str) -> str:
    """The folder of the shipped model of a hand, by the hand's name; InputError for a hand that none is shipped of."""
    if hand not in (names := _shipped()):
        near = get_close_matches(hand, names, 1)
        hint = f"; did you mean {near[0]}?" if near else "; of others: model=NAME or model=FOLDER, which train left"
        raise InputError(f"hand: expected a hand with a shipped model ({', '.join(names)}), got {hand or 'none'}{hint}")
    return f"{SHIPPED}/{hand}"


def check_place(name: str, replace: bool, key: str = "name") -> Path:
    """`models/NAME`. Raises InputError for what is no name, and where a model is that stays."""
    if not re.fullmatch(r"\w[\w.-]{0,59}", name) or name in (LATEST, NONE):
        got = name[:80] or "none"
        raise InputError(f"{key}: expected letters, digits, _, - and dots, not {LATEST} or {NONE}; got {got}")
    if name in (shipped := _shipped()):
        raise InputError(
            f"{key}: expected a name of your own, not that of a shipped model ({', '.join(shipped)}); got {name}"
        )
    return check_free(Path(OWN) / name, replace, key)


def check_free(place: Path, replace: bool, key: str) -> Path:
    """`place`, unless something is there that is no model, or a model that is not to be replaced."""
    if place.is_symlink() or (place.exists() and not place.is_dir()):
        raise InputError(f"{key}: expected a new folder or a model's, got a file or a link at {place}")
    if place.is_dir() and any(place.iterdir()):
        if not any((place / each).is_file() for each in ("model.json", "judge.json")):
            raise InputError(f"{key}: expected a new folder or a model's, got another one at {place}")
        if not replace:
            raise InputError(f"{key}: expected a new one, got {place}, which is there; replace=true replaces it")
    return place


def _shipped() -> list[str]:
    folders = sorted((root() / SHIPPED).glob("*"))
    return [folder.name for folder in folders if _any_of((*MODEL, *JUDGE), folder)]


def _any_of(names: tuple[str, ...], folder: Path) -> bool:
    return any((folder / name).is_file() for name in names)


def _words(value: Any) -> Iterator[str | Path]:
    if isinstance(value, str | Path) and value:
        yield value
    elif isinstance(value, list | tuple):
        yield from (each for each in value if isinstance(each, str | Path) and each)
