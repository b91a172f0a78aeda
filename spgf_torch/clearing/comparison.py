"""Other runs on the same scenes, whose rates stand beside: paired differences, which scenes' luck takes no part in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.clearing.config import ClutterConfig
from spgf_torch.clearing.outcomes import RESULTS, Counts, resampled
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

    @property
    def counts(self) -> Counts:
        rows = [(row["cleared"], row["attempts"], row["objects"]) for row in self.results["per_scene"]]
        return Counts(*np.array(rows, dtype=np.int64).reshape(-1, 3).T)

    @property
    def scenes(self) -> list[tuple[int, str]]:
        """Seed and objects of each."""
        return [(int(row["seed"]), str(row["names"])) for row in self.results["per_scene"]]


def beside(ours: Mapping[str, Any], others: Sequence[OtherRun], config: ClutterConfig) -> dict[str, Any]:
    """Of each other run its rates, and ours minus them with a 95 % interval over scenes.

    Raises InputError for a run of other scenes.
    """
    mine, found = OtherRun(Path(), ours), {}
    for other in others:
        if other.scenes != mine.scenes or other.results["arrangement"] != ours["arrangement"]:
            got = f"others, from seed {other.results['seed']} on, {other.results['arrangement']}"
            raise InputError(
                f"beside: expected a run on the same {len(mine.scenes)} scenes, got {got} in {other.folder}"
            )
        its: dict[str, Any] = {key: other.results[key] for key in ("method", "gsr", "dr")}
        for key, share in (("gsr", Counts.gsr), ("dr", Counts.dr)):
            its[f"{key}_difference"] = ours[key] - other.results[key]
            drawn = (resampled(run.counts, share, config) for run in (mine, other))
            its[f"{key}_difference_interval95"] = np.nanquantile(np.subtract(*drawn), (0.025, 0.975)).tolist()
        found[str(other.folder)] = its
    return found


def beside_lines(results: Mapping[str, Any]) -> list[str]:
    """Of results with `beside`, a line a run, in percentage points."""
    lines = []
    for folder, its in results.get("beside", {}).items():
        words = []
        for key in ("gsr", "dr"):
            low, high = its[f"{key}_difference_interval95"]
            words.append(f"{key.upper()} {100 * its[f'{key}_difference']:+.1f} ({100 * low:+.0f} to {100 * high:+.0f})")
        lines.append(f"{results['method']} minus {its['method']} in {folder}: {', '.join(words)} points")
    return lines
