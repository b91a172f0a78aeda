"""What `evaluate` leaves beside its `results.json`: pictures, pages and rows of executed grasps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spgf_torch.evaluation.endings import failed_grasps
from spgf_torch.evaluation.engines import Compared, engine_results, engines_csv
from spgf_torch.evaluation.tables import engines_lines, engines_table
from spgf_torch.experiment.config import EvaluateConfig
from spgf_torch.experiment.describe import Grasps
from spgf_torch.experiment.execution import Executed
from spgf_torch.extras import installed, remedy
from spgf_torch.files.writing import write_bytes, write_text
from spgf_torch.hands.records import grippers_of
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.reporting.figures.disagreements import disagreements_picture, shown_disagreements
from spgf_torch.reporting.figures.failures import failures_picture, failures_shown
from spgf_torch.reporting.pages.engines_page import engines_page
from spgf_torch.reporting.pages.failures_page import failures_page

if TYPE_CHECKING:
    from spgf_torch.hands.hand import Hand


@dataclass(frozen=True)
class Left:
    """What is written into `folder` about these objects' grasps; each method says what to tell of it."""

    folder: Path
    objects: Sequence[GraspObject]
    grasps: Sequence[Grasps]
    hand: Hand

    def both_engines(
        self, by_engine: Mapping[str, Sequence[Executed]], config: EvaluateConfig, results: dict[str, Any]
    ) -> list[Any]:
        """Add what both engines found to `results`; CSV, picture and page."""
        rows = zip(self.objects, self.grasps, *by_engine.values(), strict=True)
        compared = [Compared.of(obj, its, dict(zip(by_engine, ran, strict=True))) for obj, its, *ran in rows]
        results["engines"] = found = engine_results(compared, config)
        write_text(self.folder / "engines.csv", engines_csv(compared, results["grasp_types"]))
        told: list[Any] = [engines_table(found, config.N), *(lines := engines_lines(found))]
        shown = shown_disagreements(self.objects, compared, grippers_of(self.hand))
        if shown:
            write_bytes(self.folder / "disagreements.png", disagreements_picture(shown))
        if installed("plotly"):
            write_text(self.folder / "index.html", engines_page(found, shown, lines, config.N))
        else:
            told.append(f"no page, for which {remedy('plotly')} is needed")
        return told

    def failures(self, by_draw: Sequence[Sequence[Executed]]) -> str:
        """Picture and page of the best CG grasps that failed in any draw (`execution.execute_draws`)."""
        grippers = grippers_of(self.hand)
        failed = failed_grasps(self.objects, self.grasps, by_draw, sorted(grippers))
        if not failed:
            return f"results and settings in {self.folder}; no CG grasp failed: no picture"
        told = [f"results and settings in {self.folder}"]
        shown = failures_shown(self.objects, self.grasps, by_draw[0], grippers)
        if shown:
            write_bytes(self.folder / "failures.png", failures_picture(shown))
            told.append("failures.png shows the CG grasps that failed")
        if installed("plotly"):
            trials = sum(len(ran.best["CG"]) for executed in by_draw for ran in executed)
            write_text(self.folder / "failures.html", failures_page(failed, trials, shown))
            told.append("failures.html says of each why")
        else:
            told.append(f"no page of them, for which {remedy('plotly')} is needed")
        return "; ".join(told)
