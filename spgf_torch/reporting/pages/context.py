"""What all parts of a report are made from, and what a part is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from spgf_torch.affordance.config import JUDGE
from spgf_torch.drawing.page import Section
from spgf_torch.errors import InputError
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.reporting.data.runs import Run, Tell
from spgf_torch.reporting.data.sweep import NOMINAL_K, Sweep


@dataclass(frozen=True)
class Context:
    """The runs and the choices that every part shares.

    Attributes:
        ranking: the one that is shown; rankings: it and the others, in the table's order.
        shown: the run whose grasps and model are shown.
        tell: takes a line about what could not be used.
    """

    config: ReportConfig
    sweep: Sweep
    ranking: str
    rankings: tuple[str, ...]
    shown: Run
    tell: Tell


@dataclass(frozen=True)
class Part:
    """A section of the page and the files beside it, by name."""

    section: Section
    files: dict[str, bytes] = field(default_factory=dict)


def choose(config: ReportConfig, sweep: Sweep, tell: Tell) -> Context:
    """Which ranking and which run are shown. Raises InputError where `show` is no K of the sweep."""
    rankings = _rankings(config, sweep, tell)
    for ranking in rankings:
        if lacking := [run for run in sweep.runs if ranking not in run.by_ranking]:
            told = ", ".join(f"K = {run.K}" for run in lacking)
            tell(f"no rates by the ranking {ranking}: {told}; left out of its rows")
    return Context(config, sweep, rankings[0], rankings, _shown(config, sweep, rankings[0]), tell)


def tell_replaced(runs: Sequence[Run], sweep: Sweep, tell: Tell) -> None:
    """A line about runs with the ranking `judge` for which newer ones of the same settings stand that lack it."""
    used = {run.folder for run in (*sweep.runs, *(variant.run for variant in sweep.variants))}
    for run in runs:
        if JUDGE in run.by_ranking and run.folder not in used:
            newer = [other for other in (*sweep.runs, *(v.run for v in sweep.variants)) if other.K == run.K]
            if not any(JUDGE in other.by_ranking for other in newer):
                tell(
                    f"no ranking {JUDGE} of K = {run.K}: {run.folder.name} has it, a newer run of its settings has not"
                )


def best_run(runs: tuple[Run, ...], ranking: str) -> Run:
    """The run with the highest CG over all objects; of equal ones that of the smallest K."""
    ranked = [run for run in runs if ranking in run.by_ranking]
    return max(ranked, key=lambda run: (run.by_ranking[ranking]["all"]["CG"], -run.K))


def _rankings(config: ReportConfig, sweep: Sweep, tell: Tell) -> tuple[str, ...]:
    """Those that any run has, the shown one first; another one is shown where none has it.

    `judge` joins where a run has it: only those that were asked for do.
    """
    known = dict.fromkeys(name for run in sweep.runs for name in run.by_ranking)
    wanted = dict.fromkeys([config.ranking, *config.rankings, *(name for name in known if name == JUDGE)])
    present = tuple(name for name in wanted if name in known) or tuple(known)
    if not present:
        raise InputError(f"runs: expected rates by the ranking {config.ranking}, got none by any")
    if absent := [name for name in wanted if name not in known]:
        instead = "" if config.ranking in known else f"; {present[0]} is shown instead"
        tell(f"no run has rates by the ranking {', '.join(absent)}{instead}")
    return present


def _shown(config: ReportConfig, sweep: Sweep, ranking: str) -> Run:
    if config.show is not None:
        run = sweep.of(config.show)
        if run is None:
            raise InputError(f"show: expected one of K = {', '.join(str(r.K) for r in sweep.runs)}; got {config.show}")
        return run
    modelled = tuple(run for run in sweep.runs if run.has_model and ranking in run.by_ranking)
    nominal = sweep.of(NOMINAL_K)
    return nominal if nominal in modelled and nominal else best_run(modelled or sweep.runs, ranking)
