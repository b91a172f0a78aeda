"""Several inputs of one call, each with a folder named by it; what one is refused does not stop the others."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from spgf_torch.errors import IncompleteError, InputError


def named(inputs: Sequence[str]) -> list[str]:
    """A name for each input: its stem; with its extension, then a number, where that is another's already."""
    stems = [Path(each).stem or "input" for each in inputs]
    names: list[str] = []
    for each, stem in zip(inputs, stems, strict=True):
        name = stem if stems.count(stem) == 1 else Path(each).name
        wanted = [name, *(f"{name}_{number}" for number in range(2, len(inputs) + 2))]
        names.append(next(word for word in wanted if word not in names))
    return names


def run_each(command: str, inputs: Sequence[str], folder: Path, work: Callable[[str, Path], None]) -> None:
    """Call `work(input, folder / name)` for each input; what it may not use is a line on stderr.

    Raises InputError where none of them could be used, IncompleteError where some could not.
    """
    refused = 0
    for each, name in zip(inputs, named(inputs), strict=True):
        place = folder / name
        place.mkdir()
        try:
            work(each, place)
        except InputError as error:
            refused += 1
            told = str(error) if str(error).startswith(each) else f"{each}: {error}"
            print(f"{command}: {told}", file=sys.stderr)
            with suppress(OSError):
                place.rmdir()
    if refused == len(inputs):
        raise InputError(f"expected one input at least that can be used, got none of {refused}")
    if refused:
        raise IncompleteError(f"{refused} of {len(inputs)} inputs not done; the others are in {folder}")
