"""One row of a table of recorded trials: its values, each checked and named where it is wrong."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spgf_torch.errors import InputError
from spgf_torch.formats.recorded_columns import VIEW
from spgf_torch.objects.manifest import CATEGORIES, check_name

TCP, BASE = "tcp", "base"
OUTCOMES = {"1": True, "true": True, "0": False, "false": False}


@dataclass(frozen=True)
class Recording:
    """What was grasped, as the table names it: the first row that does is `row`.

    Attributes:
        cloud: the file of what was seen; None: the object's mesh is what is learned from.
        viewpoint: (3,) m, where the camera was, in the cloud's frame; None: the file tells.
        category: one of `objects.config.CLASSES`; None: the table does not say.
    """

    object_name: str
    cloud: Path | None
    viewpoint: tuple[float, ...] | None
    category: str | None
    row: int


@dataclass(frozen=True)
class Row:
    """One row: its number, and column -> value, where there is one."""

    path: Path
    number: int
    values: Mapping[str, Any]

    def wrong(self, column: str, expected: str) -> InputError:
        """That a value is none that was expected."""
        value = self.values.get(column)
        got = "nothing" if value is None else repr(value)[:60]
        return InputError(f"{self.path}: row {self.number}: {column}: expected {expected}, got {got}")

    def number_in(self, column: str) -> float:
        """A finite number."""
        value = self.values.get(column)
        try:
            known = math.nan if value is None or isinstance(value, bool) else float(value)
        except (TypeError, ValueError):
            known = math.nan
        if not math.isfinite(known):
            raise self.wrong(column, "a finite number")
        return known

    def success(self) -> bool:
        """How the trial ended."""
        value = self.values.get("success")
        word = str(value).strip().lower()
        if isinstance(value, float) and value in (0.0, 1.0):
            word = str(int(value))
        if word not in OUTCOMES:
            raise self.wrong("success", "1 or 0")
        return OUTCOMES[word]

    def type(self, types: Sequence[str]) -> int:
        """Index of the grasp type; of a hand with one nothing need be said."""
        value = self.values.get("type")
        if value is None and len(types) == 1:
            return 0
        if value not in types:
            raise self.wrong("type", f"one of {', '.join(types)}")
        return types.index(value)

    def of_base(self) -> bool:
        """Whether the pose is that of the hand's base."""
        frame = self.values.get("frame", TCP)
        if frame not in (TCP, BASE):
            raise self.wrong("frame", f"{TCP} or {BASE}")
        return bool(frame == BASE)

    def recording(self) -> Recording:
        """What was grasped."""
        name = self.values.get("object")
        if name is None:
            raise self.wrong("object", "the name of an object")
        check_name(str(name), f"{self.path}: row {self.number}: object")
        category = self.values.get("class")
        if category is not None and category not in CATEGORIES:
            raise self.wrong("class", f"one of {', '.join(CATEGORIES)}")
        viewpoint = None
        if any(column in self.values for column in VIEW):
            viewpoint = tuple(self.number_in(column) for column in VIEW)
        known = None if category is None else CATEGORIES[category]
        return Recording(str(name), self._cloud(), viewpoint, known, self.number)

    def _cloud(self) -> Path | None:
        value = self.values.get("cloud")
        if value is None:
            return None
        file = self.path.parent / str(value)
        if not file.is_file():
            raise self.wrong("cloud", f"a file in {self.path.parent}")
        return file
