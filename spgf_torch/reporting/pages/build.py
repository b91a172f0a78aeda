"""The whole report: read the runs, make its parts, write its files."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from spgf_torch.drawing.page import Section, page
from spgf_torch.errors import InputError
from spgf_torch.evaluation.predictions import Predictions
from spgf_torch.files.writing import write_bytes
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import find
from spgf_torch.progress import ProgressReporter
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.reporting.data.predictions import predictions_of
from spgf_torch.reporting.data.runs import Notes, Run
from spgf_torch.reporting.data.sweep import find_sweep
from spgf_torch.reporting.pages.context import Context, Part, choose, tell_replaced
from spgf_torch.reporting.pages.grasp_parts import precision_part, reliability_part, worst_part
from spgf_torch.reporting.pages.method_parts import example, overview_part, setup_part, sheet_part, steps_part
from spgf_torch.reporting.pages.model_parts import grasps_part, objects_part, prototypes_part
from spgf_torch.reporting.pages.pictured import Pictured, check_asked, pictured
from spgf_torch.reporting.pages.rate_parts import ablation_part, choice_part, headline, over_k, table_part
from spgf_torch.reporting.pages.reach_part import reach_part
from spgf_torch.reporting.pages.table1 import Table1, table1

T = TypeVar("T")

TITLE = "Sliced Pineapple Grid Features (SPGF), the paper's experiment again"


def build(config: ReportConfig, runs: Sequence[Run], folder: Path, stages: ProgressReporter, notes: Notes) -> Table1:
    """Write the report on `runs` (oldest first) into `folder`; returns Table 1.

    What cannot be used is noted in a line each and leaves its figures out. Raises InputError where `show` is no K of
    the runs, `pictured` or `fold` is of no model, or no run has rates.
    """
    context = choose(config, sweep := find_sweep(runs, config.bootstrap, config.seed, notes), notes)
    check_asked(context)
    tell_replaced(runs, sweep, notes)
    rates = table1(sweep.rows, sweep.classwise(), context.rankings, context.row)
    parts = [*_rates(context, rates, stages), *_grasps_and_model(context, stages)]
    if ablated := ablation_part(context):
        parts.append(ablated)
    for part in parts:
        for name, content in part.files.items():
            write_bytes(folder / name, content)
    sections = [*(part.section for part in parts), _left_out(notes.lines)]
    count = "1 run" if len(runs) == 1 else f"{len(runs)} runs"
    lead = (
        "<p>Thomsen, Kraft, Kr&uuml;ger (2016), A Semi-local Surface Feature for Learning Successful Grasping "
        f"Affordances: {_made_again(context)} from {count}.</p>"
    )
    write_bytes(folder / "index.html", page(TITLE, lead, sections).encode())
    return rates


def _made_again(context: Context) -> str:
    """What of the paper, in words."""
    if context.row.of_papers_hand:
        return "Table 1 and Figures 1 to 13, made again"
    name = html.escape(str(context.shown.settings["hand"].get("name", "another hand"))[:60])
    return f"its table and figures for another hand than the paper's, {name},"


def _rates(context: Context, rates: Table1, stages: ProgressReporter) -> list[Part]:
    with stages.stage("rates", 5, "parts") as advance:
        return _made(
            [
                lambda: headline(context),
                lambda: table_part(context, rates),
                lambda: choice_part(context),
                lambda: over_k(context),
                lambda: reach_part(context),
            ],
            context,
            advance,
        )


def _grasps_and_model(context: Context, stages: ProgressReporter) -> list[Part]:
    """The parts of the shown run; in place of those whose files cannot be used stands a sentence."""
    library = _usable(context, lambda: _library(context)) or {}
    objects = _usable(context, lambda: predictions_of(context.shown, context.ranking))
    shown = _usable(context, lambda: pictured(context, library))
    steps = [
        *_method_steps(context, shown, library, objects or []),
        *_model_steps(context, shown, library),
        *_grasp_steps(context, objects, library),
    ]
    with stages.stage("figures", len(steps), "figures") as advance:
        return _made(steps, context, advance)


def _method_steps(
    context: Context, shown: Pictured | None, library: dict[str, GraspObject], objects: list[Predictions]
) -> list[Callable[[], Part]]:
    """Figs. 1 to 8; none without a model and objects."""
    if shown is None or not library or (given := _usable(context, lambda: example(shown, library, objects))) is None:
        return []
    return [
        lambda: overview_part(context, shown, given),
        lambda: steps_part(shown, given, objects),
        lambda: setup_part(shown, given, objects),
        lambda: sheet_part(shown),
    ]


def _model_steps(context: Context, shown: Pictured | None, library: dict[str, GraspObject]) -> list[Callable[[], Part]]:
    if shown is None:
        return [lambda: _missing("fig10", "Figs. 10 to 13", context, "no model that can be read")]
    steps: list[Callable[[], Part]] = [lambda: prototypes_part(shown)]
    if library:
        steps.append(lambda: objects_part(context, shown, library))
    return [*steps, *(lambda kind=kind: grasps_part(context, shown, kind) for kind in shown.model.grasp_types)]  # type: ignore[misc]


def _grasp_steps(
    context: Context, objects: list[Predictions] | None, library: dict[str, GraspObject]
) -> list[Callable[[], Part]]:
    if objects is None:
        return [lambda: _missing("precision", "Single grasps", context, "no predictions that can be read")]
    known = objects
    return [
        lambda: reliability_part(context, known),
        lambda: precision_part(context, known),
        lambda: worst_part(context, known, library, context.grippers),
    ]


def _made(steps: Sequence[Callable[[], Part | None]], context: Context, advance: Callable[[int], None]) -> list[Part]:
    parts = []
    for step in steps:
        if (part := _usable(context, step)) is not None:
            parts.append(part)
        advance(1)
    return parts


def _library(context: Context) -> dict[str, GraspObject]:
    return {obj.name: obj for obj in load_objects(find(context.shown.settings["objects"]))}


def _usable(context: Context, read: Callable[[], T]) -> T | None:
    """What `read` returns; where that is refused, a line is told and the figures that need it are left out."""
    try:
        return read()
    except InputError as error:
        context.tell(f"figures left out: {error}")
        return None


def _missing(id: str, title: str, context: Context, words: str) -> Part:
    text = f"The run shown ({html.escape(context.shown.folder.name)}, K = {context.shown.K}) has {words}."
    return Part(Section(id, title, f"<p>{text}</p>"))


def _left_out(notes: Sequence[str]) -> Section:
    items = "".join(f"<li>{html.escape(line)}</li>" for line in notes) or "<li>Nothing.</li>"
    return Section("notes", "Left out", f"<p>What was found in the runs and is not in this report:</p><ul>{items}</ul>")
