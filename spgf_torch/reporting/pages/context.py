"""What all parts of a report are made from, and what a part is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

from spgf_torch.affordance.config import JUDGE
from spgf_torch.drawing.page import Section
from spgf_torch.errors import InputError
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.hands.records import Gripper, grippers_of
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.reporting.data.runs import Run, Tell
from spgf_torch.reporting.data.seeds import Repeats
from spgf_torch.reporting.data.sweep import NOMINAL_K, Sweep
from spgf_torch.settings import typed


@dataclass(frozen=True)
class Context:
    """The runs and the choices that every part shares.

    Attributes:
        ranking: the one that is shown; rankings: it and the others, in the table's order.
        shown: the run whose grasps and model are shown, one of `row`, the experiment whose rates stand for its K.
        tell: takes a line about what could not be used.
    """

    config: ReportConfig
    sweep: Sweep
    ranking: str
    rankings: tuple[str, ...]
    row: Repeats
    shown: Run
    tell: Tell

    @cached_property
    def grippers(self) -> dict[str, Gripper]:
        """Grasp type -> the hand of the shown run, open. Raises InputError where its files cannot be read."""
        return grippers_of_run(self.shown)

    @property
    def second(self) -> str | None:
        """The ranking that stands beside the shown one, if there is another."""
        return self.rankings[1] if len(self.rankings) > 1 else None


def grippers_of_run(run: Run) -> dict[str, Gripper]:
    """Grasp type -> the hand of a run, open. Raises InputError where its files cannot be read."""
    return grippers_of(load_hand(typed(HandConfig, run.settings["hand"])))


@dataclass(frozen=True)
class Part:
    """A section of the page and the files beside it, by name."""

    section: Section
    files: dict[str, bytes] = field(default_factory=dict)


def choose(config: ReportConfig, sweep: Sweep, tell: Tell) -> Context:
    """Which ranking and which run are shown. Raises InputError where `show` is no K of the sweep."""
    rankings = _rankings(config, sweep, tell)
    for ranking in rankings:
        if lacking := [row for row in sweep.rows if ranking not in row.by_ranking]:
            told = ", ".join(f"K = {row.K}" for row in lacking)
            tell(f"no rates by the ranking {ranking}: {told}; left out of its rows")
    return Context(config, sweep, rankings[0], rankings, *_shown(config, sweep, rankings[0]), tell)


def tell_replaced(runs: Sequence[Run], sweep: Sweep, tell: Tell) -> None:
    """A line about runs with the ranking `judge` for which newer ones of the same settings stand that lack it."""
    every = [run for row in (*sweep.rows, *(variant.runs for variant in sweep.variants)) for run in row.runs]
    used = {run.folder for run in every}
    for run in runs:
        if JUDGE in run.by_ranking and run.folder not in used:
            newer = [other for other in every if other.K == run.K]
            if not any(JUDGE in other.by_ranking for other in newer):
                tell(
                    f"no ranking {JUDGE} of K = {run.K}: {run.folder.name} has it, a newer run of its settings has not"
                )


def _rankings(config: ReportConfig, sweep: Sweep, tell: Tell) -> tuple[str, ...]:
    """Those that any run has, the shown one first; another one is shown where none has it.

    `judge` joins where a run has it: only those that were asked for do.
    """
    known = dict.fromkeys(name for row in sweep.rows for name in row.by_ranking)
    wanted = dict.fromkeys([config.ranking, *config.rankings, *(name for name in known if name == JUDGE)])
    present = tuple(name for name in wanted if name in known) or tuple(known)
    if not present:
        raise InputError(f"runs: expected rates by the ranking {config.ranking}, got none by any")
    if absent := [name for name in wanted if name not in known]:
        instead = "" if config.ranking in known else f"; {present[0]} is shown instead"
        tell(f"no run has rates by the ranking {', '.join(absent)}{instead}")
    return present


def _shown(config: ReportConfig, sweep: Sweep, ranking: str) -> tuple[Repeats, Run]:
    """The K that was asked for, else of those with a model 20 or the one with the best CG; of its runs one with it."""
    ranked = [row for row in sweep.rows if ranking in row.by_ranking]
    shown = [row for row in ranked if any(run.has_model for run in row.runs)] or ranked
    row = sweep.of(NOMINAL_K if config.show is None else config.show)
    if config.show is not None and row is None:
        raise InputError(f"show: expected one of K = {', '.join(str(r.K) for r in sweep.rows)}; got {config.show}")
    if row is None or (config.show is None and row not in shown):
        row = max(shown, key=lambda row: (row.rate(ranking), -row.K))
    having = [run for run in row.runs if ranking in run.by_ranking] or list(row.runs)
    return row, next((run for run in having if run.has_model), having[0])
