"""Other runs on the same scenes, whose rates stand beside: paired differences, which scenes' luck takes no part in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.clearing.config import ClutterConfig
from spgf_torch.clearing.outcomes import RESULTS, Counts, Parts, resampled, share, share_in, stated
from spgf_torch.drawing.clutter_records import Share
from spgf_torch.errors import InputError
from spgf_torch.files.reading import json_values
from spgf_torch.paths import find


@dataclass(frozen=True)
class OtherRun:
    """What another run came to: `results` as its `results.json` has them."""

    folder: Path
    results: Mapping[str, Any]

    @staticmethod
    def read(folder: str) -> OtherRun:
        """Raises InputError where there is no finished run of clutter."""
        path = find(folder) / RESULTS
        try:
            results = json_values(path, "results of clutter", sealed=True)
            OtherRun(path.parent, results).counts  # noqa: B018
        except (KeyError, TypeError, ValueError, AttributeError):
            raise InputError(f"{path}: expected results of clutter, got something else") from None
        return OtherRun(path.parent, results)

    def check(self, config: ClutterConfig) -> None:
        """Raise InputError unless it is on the scenes that the settings name, as far as seeds tell."""
        seeds = list(range(config.seed, config.seed + config.scenes))
        if [seed for seed, _ in self.scenes] != seeds or self.results["arrangement"] != config.arrangement.kind:
            raise self.other_scenes(config.scenes)

    def other_scenes(self, scenes: int) -> InputError:
        """That it is on other scenes than these."""
        its = f"{self.results['arrangement']}, {len(self.scenes)} from seed {self.results['seed']} on"
        return InputError(f"beside: expected a run on the same {scenes} scenes, got others ({its}) in {self.folder}")

    @property
    def counts(self) -> Counts:
        rows = [(row["cleared"], row["attempts"], row["objects"]) for row in self.results["per_scene"]]
        return Counts(*np.array(rows, dtype=np.int64).reshape(-1, 3).T)

    @property
    def scenes(self) -> list[tuple[int, list[str]]]:
        """Seed and objects of each."""
        return [(int(row["seed"]), _names(row["names"])) for row in self.results["per_scene"]]


def _names(told: list[str] | str) -> list[str]:
    """Of the objects in a scene; older runs have them in one text."""
    return told.split() if isinstance(told, str) else list(told)


def beside(ours: Mapping[str, Any], others: Sequence[OtherRun], config: ClutterConfig) -> dict[str, Any]:
    """Of each other run its rates, and ours minus them with a 95 % interval over scenes.

    Raises InputError for a run of other scenes.
    """
    mine, found = OtherRun(Path(), ours), {}
    for other in others:
        if other.scenes != mine.scenes or other.results["arrangement"] != ours["arrangement"]:
            raise other.other_scenes(len(mine.scenes))
        its: dict[str, Any] = {key: other.results[key] for key in ("method", "gsr", "dr")}
        for key, parts in (("gsr", Counts.gsr), ("dr", Counts.dr)):
            its |= stated(f"{key}_difference", _difference(mine.counts, other.counts, parts, config))
        found[str(other.folder)] = its
    return found


def _difference(ours: Counts, theirs: Counts, parts: Parts, config: ClutterConfig) -> Share:
    """Ours minus theirs over all scenes; NaN where one has tried nothing."""
    ends = [share(counts, parts, config).value for counts in (ours, theirs)]
    if np.isnan(ends).any():
        return Share(np.nan, np.nan, np.nan)
    drawn = [resampled(counts, parts, config) for counts in (ours, theirs)]
    low, high = np.nanquantile(drawn[0] - drawn[1], (0.025, 0.975))
    return Share(ends[0] - ends[1], float(low), float(high))


def beside_lines(results: Mapping[str, Any]) -> list[str]:
    """Of results with `beside`, a line a run, in percentage points."""
    lines = []
    for folder, its in results.get("beside", {}).items():
        shares = {key.upper(): share_in(its, f"{key}_difference") for key in ("gsr", "dr")}
        words = [
            f"{name} {100 * each.value:+.1f} ({100 * each.low:+.0f} to {100 * each.high:+.0f})"
            for name, each in shares.items()
        ]
        lines.append(f"{results['method']} minus {its['method']} in {folder}: {', '.join(words)} points")
    return lines
