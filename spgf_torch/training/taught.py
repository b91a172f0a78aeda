"""What a training learns from: objects or recorded views of them, and the outcomes of grasps on each."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from spgf_torch.experiment.named import Named

if TYPE_CHECKING:
    from torch import Tensor

    from spgf_torch.experiment.describe import Describer, Seen
    from spgf_torch.experiment.described_object import DescribedObject
    from spgf_torch.formats.recorded_trials import RecordedTrials
    from spgf_torch.progress import ProgressReporter
    from spgf_torch.simulation.table import TrialTable

Tried: TypeAlias = "TrialTable | RecordedTrials"
Tell: TypeAlias = Callable[[Any], None]


@dataclass(frozen=True)
class Taught:
    """Objects and the trials on each.

    Attributes:
        seen: bodies, or recorded views, of which an object may have several, one after the other.
        tables: the trials on each of these.
        why_unmeasured: why rates of these trials would say nothing, if so.
    """

    seen: Sequence[Seen]
    tables: Sequence[Tried]
    why_unmeasured: str = ""

    @property
    def owners(self) -> list[str]:
        """Of each of `seen` the name of the object."""
        return [getattr(its, "object_name", its.name) for its in self.seen]

    @property
    def members(self) -> dict[str, list[int]]:
        """Of each object its places in `seen`."""
        found: dict[str, list[int]] = {}
        for place, owner in enumerate(self.owners):
            found.setdefault(owner, []).append(place)
        return found

    def objects(self) -> list[Named]:
        """What each is called."""
        return [
            Named(name, self.seen[places[0]].category, _digest([self.seen[place] for place in places]))
            for name, places in self.members.items()
        ]

    @property
    def simulated(self) -> list[TrialTable]:
        """The tables that simulation made: all, or none."""
        from spgf_torch.simulation.table import TrialTable

        return [table for table in self.tables if isinstance(table, TrialTable)]

    def by_object(self) -> list[Tried]:
        """The trials of each object."""
        from spgf_torch.formats.recorded_trials import RecordedTrials

        return [
            self.tables[places[0]]
            if len(places) == 1
            else RecordedTrials.joined([self.tables[place] for place in places])  # type: ignore[misc]
            for places in self.members.values()
        ]

    def examples(self, describer: Describer, stages: ProgressReporter) -> list[DescribedObject]:
        """The objects as they are learned from, with the outcomes of their trials."""
        from spgf_torch.experiment.described_object import DescribedObject

        described = describer.describe(self.seen, self.tables, stages)
        tried = [each.with_success(its.success) for each, its in zip(described, self.tables, strict=True)]
        return [DescribedObject.joined([tried[place] for place in places]) for places in self.members.values()]


def _digest(seen: Sequence[Seen]) -> str:
    """Of an object: its own, or over those of its views."""
    if len(seen) == 1:
        return seen[0].digest
    return hashlib.sha256("".join(its.digest for its in seen).encode()).hexdigest()


def counts(tables: Sequence[Tried], tell: Tell) -> None:
    """A line: how many trials of each grasp type there are, and how many held."""
    types = tables[0].grasp_types
    words = []
    for code, name in enumerate(types):
        outcomes: list[Tensor] = [table.success[table.grasp_type == code] for table in tables]
        tried, held = sum(map(len, outcomes)), sum(int(each.sum()) for each in outcomes)
        words.append(f"{name} {held:,} of {tried:,} held" + (f" ({held / tried:.0%})" if tried else ""))
    total = sum(map(len, tables))
    tell(f"{total:,} trials: {', '.join(words)}")
