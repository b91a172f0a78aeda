"""What people see in the terminal: ours beside the paper and beside chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.table import Table

from spgf_torch.affordance.config import JUDGE, NESTED
from spgf_torch.evaluation import paper
from spgf_torch.evaluation.reliability import PREDICTORS
from spgf_torch.evaluation.results import KNOWS_MORE, chosen_words
from spgf_torch.evaluation.success import ALL, class_means, random_rate
from spgf_torch.objects.config import CLASSES
from spgf_torch.second_engine.physics import MUJOCO, NAMES, SAPIEN
from spgf_torch.simulation.table import OUTCOMES

SHORT = {"containers": "cont"}  # as in the paper's Table 1: the table fits 80 columns
SUCCESS, COLLISION = OUTCOMES.index("success"), OUTCOMES.index("collision")
CHECK = "python -m spgf_torch.hand"  # closes a hand without an object, and says what is wrong with it

if TYPE_CHECKING:
    from spgf_torch.objects.scans import Scan
    from spgf_torch.simulation.table import TrialTable

Block = Mapping[str, Mapping[str, float]]


def results_table(results: Mapping[str, Any], rankings: Sequence[str] | None = None) -> Table:
    """Table 1 for this K, in percent: the paper's rate, ours by two rankings with 95 % intervals, chance, ceiling.

    A row a class that occurs and type, so that it fits 80 columns. The paper's rates stand beside those of its own hand
    alone; where each class was learned by itself, they are those of its row [*], Thomsen et al. (2015).

    Args:
        rankings: at most two; None: `paper` and `nested`, or where a judge ranked `nested` and `judge`.
    """
    K = results["K"]
    rankings = rankings or ((NESTED, JUDGE) if JUDGE in results["by_ranking"] else ("paper", NESTED))
    classwise = bool(results.get("classwise"))
    printed = paper.CLASSWISE if classwise else paper.SUCCESS_RATE.get(K, {})
    papers = _papers(results)
    table = Table(
        title=f"Success-rate (%) of the {results['N']} highest-ranked grasps on novel objects, K = {K}"
        + (", each class by itself" if classwise else ""),
        caption=f"(low-high): 95 % interval over objects, of one seed ({results['seed']}). "
        + (f"{paper.OTHER_DATA} " if papers else "")
        + (f"{KNOWS_MORE} " if NESTED in rankings else "")
        + "free: candidates without a sensed collision.",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        padding=(0, 0, 0, 1),
        pad_edge=False,
    )
    table.add_column("", no_wrap=True)
    named = {"paper": "paper's\nranking", NESTED: "our rank-\ning, nested"}
    ours = [named.get(r, f"ours\n{r}") for r in rankings]
    theirs = ["[*]\n2015" if classwise else "the\npaper"], ["random\npaper"]
    beside = theirs if papers else ([], [])
    for heading in [*beside[0], *ours, *beside[1], "random\nours", "random\nfree", "ceil-\ning"]:
        table.add_column(heading, justify="right", no_wrap=True)
    for name in (name for name in (*CLASSES, "all") if name in results["by_ranking"][rankings[0]]):
        for grasp_type in (*results["grasp_types"], ALL):
            label = f"{SHORT.get(name, name)} {grasp_type}"
            cells = _cells(results, rankings, printed if papers else None, name, grasp_type)
            table.add_row(label, *cells, end_section=grasp_type == ALL)
    return table


def _cells(
    results: Mapping[str, Any], rankings: Sequence[str], printed: Block | None, name: str, grasp_type: str
) -> list[str]:
    """A row of `results_table`, of a class and type; `printed`: the paper's rates, None where they are left out."""
    ours = [
        f"{_percent(results['by_ranking'][ranking], name, grasp_type)} "
        f"{_interval(results['interval95_by_ranking'][ranking], name, grasp_type)}"
        for ranking in rankings
    ]
    blocks = [results[block] for block in ("random", "random_collision_free", "ceiling")]
    chance = [_percent(block, name, grasp_type) for block in blocks]
    if printed is None:
        return [*ours, *chance]
    rate, random = (_percent(block, name, grasp_type, scale=1) for block in (printed, paper.RANDOM))
    return [rate, *ours, random, *chance]


def chosen_line(results: Mapping[str, Any]) -> str:
    """Which ranking the training folds chose, in a line."""
    return f"nested: the ranking chosen inside the training folds: {chosen_words(results['chosen'])}"


def calibration_lines(results: Mapping[str, Any]) -> list[str]:
    """Brier score and expected calibration error of the probabilities, in a line of each group of candidates."""
    groups = {"calibration_free": "candidates without a sensed collision", "calibration": "all candidates"}
    return [
        f"Brier score / expected calibration error, {words}: "
        + "; ".join(
            f"{grasp_type} " + ", ".join(f"{told} {scores}" for told, scores in _scores(block).items())
            for grasp_type, block in results[key].items()
        )
        for key, words in groups.items()
    ]


def _scores(block: Mapping[str, float]) -> dict[str, str]:
    return {told: f"{block[f'brier{end}']:.3f} / {block[f'ece{end}']:.3f}" for end, told in PREDICTORS.items()}


def judge_lines(results: Mapping[str, Any]) -> list[str]:
    """Of a run with the ranking `judge`: what it knows more, how it compares with the votes, its calibration."""
    if JUDGE not in results["by_ranking"]:
        return []
    change = results["judge_minus_nested"]
    mean, (low, high) = change["mean"]["all"]["CG"], change["interval95"]["all"]["CG"]
    blocks = results["calibration_by_ranking"][JUDGE].items()
    told = ", ".join(f"{grasp_type} {block['ece']:.3f}" for grasp_type, block in blocks)
    return [
        "judge: learned from the same trials, not from votes; it also knows unseen space and which trials collided",
        f"judge minus nested, CG, all: {100 * mean:+.1f} points ({100 * low:+.1f} to {100 * high:+.1f}, paired)",
        f"expected calibration error of the judge, candidates without a sensed collision: {told}",
    ]


def random_rates(classes: Sequence[str], tables: Sequence[TrialTable], papers: bool) -> Table:
    """Chance in the trial tables of objects of these classes; `papers`: beside the paper's, whose hand it is."""
    types = tables[0].grasp_types
    rates = [random_rate(its.success.numpy(), its.grasp_type.numpy(), types) for its in tables]
    ours = class_means(classes, [{name: rate[name] for name in types} for rate in rates])
    headings = ("", "paper", "this table") if papers else ("", "this table")
    table = Table(*headings, title="Success-rate (%) of a random candidate", box=box.SIMPLE_HEAD)
    for row in ((category, name) for category in ours for name in types):
        theirs = [_percent(paper.RANDOM, *row, scale=1)] if papers else []
        table.add_row(" ".join(row), *theirs, _percent(ours, *row))
    return table


def hopeless_types(tables: Sequence[TrialTable], hand: str) -> list[str]:
    """A line for each grasp type of which no trial held, over all objects: the hand `hand` is likely to be wrong."""
    outcome, grasp_type = (
        np.concatenate([getattr(table, name).numpy() for table in tables]) for name in ("outcome", "grasp_type")
    )
    lines = []
    for code, name in enumerate(tables[0].grasp_types):
        counts = np.bincount(outcome[grasp_type == code], minlength=len(OUTCOMES))
        if not counts[SUCCESS]:
            lines.append(
                f"NO SUCCESS with the grasp type {name}: of {counts.sum():,} trials none held its object, in "
                f"{counts[COLLISION]:,} the open hand cut it; check {hand}, given as here: {CHECK} hand=..."
            )
    return lines


def executed_table(results: Mapping[str, Any]) -> Table:
    """Per object and class: the share of the best grasps that were held, beside random candidates; in percent.

    Of two engines the first's.
    """
    engine = NAMES[MUJOCO if results["engine"] == MUJOCO else SAPIEN]
    table = Table(title=f"Held in {engine} (%): the {results['N']} highest-ranked grasps, and random candidates")
    table.add_column("object")
    table.add_column("class")
    types = (*results["grasp_types"], ALL)
    for name in (*types, *(f"random {name}" for name in types)):
        table.add_column(name, justify="right")
    for row in results["per_object"]:
        rates = [block[grasp_type] for block in (row, row["random"]) for grasp_type in types]
        table.add_row(row["object"], row["class"], *(f"{100 * rate:.1f}" for rate in rates))
    table.add_section()
    for name, block in results["success_rate"].items():
        rates = [its[grasp_type] for its in (block, results["random"][name]) for grasp_type in types]
        table.add_row("mean", name, *(f"{100 * rate:.1f}" for rate in rates))
    low, high = results["interval95"]["all"]["CG"]
    table.caption = f"CG, all: 95 % interval over objects {100 * low:.0f} to {100 * high:.0f} %"
    return table


def draws_table(found: Mapping[str, Any], n: int) -> Table:
    """Per object: in which share of the draws the best grasps hold, of each type and CG; found: `draw_results`."""
    types = [name for name in found["success_rate"]["all"] if name != ALL]
    table = Table(title=f"The {n} highest-ranked grasps in {found['draws']} draws: held (%)")
    table.add_column("object")
    for name in (*types, ALL, f"{ALL} in all draws"):
        table.add_column(name, justify="right")
    for row in found["per_object"]:
        table.add_row(row["object"], *(f"{100 * row[name]:.1f}" for name in (*types, ALL, "all_draws")))
    table.add_section()
    means = [*(found["success_rate"]["all"][name] for name in (*types, ALL)), found["all_draws"]]
    table.add_row("all", *(f"{100 * rate:.1f}" for rate in means))
    low, high = found["interval95"]["all"][ALL]
    table.caption = f"CG, all: 95 % interval over objects {100 * low:.0f} to {100 * high:.0f} %"
    return table


def engines_table(engines: Mapping[str, Any], n: int) -> Table:
    """Per object: the best grasps (CG) that each engine and both held, in percent, and on how many they disagree."""
    table = Table(title=f"The {n} highest-ranked grasps (CG) in two engines: held (%)")
    table.add_column("object")
    for name in ("SAPIEN", "MuJoCo", "both", "free grasps", "disagree"):
        table.add_column(name, justify="right")
    columns = (SAPIEN, MUJOCO, "both")
    for row in engines["per_object"]:
        counts = (str(row["free"]), str(row["disagree"]))
        table.add_row(row["object"], *(f"{100 * row[name]:.1f}" for name in columns), *counts)
    table.add_section()
    rates = (f"{100 * engines[name]['success_rate']['all'][ALL]:.1f}" for name in columns)
    totals = (str(sum(row[name] for row in engines["per_object"])) for name in ("free", "disagree"))
    table.add_row("all", *rates, *totals)
    low, high = engines["both"]["interval95"]["all"][ALL]
    table.caption = f"both, all: 95 % interval over objects {100 * low:.0f} to {100 * high:.0f} %"
    return table


def engines_lines(engines: Mapping[str, Any]) -> list[str]:
    """On how many of the grasps the engines agree, and how the others end in each."""
    lines = []
    for name, words in (
        ("best", "the best grasps (CG)"),
        ("free", "all grasps that the open hand does not collide in"),
    ):
        its = engines["agreement"][name]
        if its["grasps"]:
            low, high = (100 * end for end in its["interval95"])
            share = f"{100 * its['share']:.1f} % (95 % interval over objects {low:.0f}-{high:.0f})"
            lines.append(f"engines agree whether it holds: {share} of {its['grasps']:,}, {words}")
    apart = [row for row in engines["outcomes"] if (row[SAPIEN] == "success") != (row[MUJOCO] == "success")]
    ends = ", ".join(f"{row['grasps']} {row[SAPIEN]} / {row[MUJOCO]}" for row in apart)
    return [*lines, f"disagreements, SAPIEN / MuJoCo: {ends or 'none'}"]


def scans_table(scans: Sequence[Scan]) -> Table:
    """Of each scanned mesh: its collision pieces, and the checks that they keep its volume and its cavity."""
    table = Table(title="Scanned meshes and their collision pieces", box=box.SIMPLE_HEAD)
    for heading in ("object", "class", "extent (mm)", "mass (g)", "pieces", "volume ratio", "cavity kept (%)"):
        table.add_column(heading, justify="left" if heading in ("object", "class") else "right")
    for scan in scans:
        extent = " x ".join(f"{1000 * side:.0f}" for side in scan.object.mesh.extents)
        check = scan.check
        table.add_row(
            scan.object.name,
            scan.object.category,
            extent,
            f"{1000 * scan.object.mass:.0f}",
            str(check.pieces),
            f"{check.volume_ratio:.2f}",
            f"{100 * check.free_space_kept:.1f}",
        )
    return table


def _papers(results: Mapping[str, Any]) -> bool:
    """Whether results are of the paper's hand."""
    return bool(results["hand"] == paper.HAND and tuple(results["grasp_types"]) == paper.TYPES)


def _percent(block: Block, name: str, grasp_type: str, scale: float = 100) -> str:
    rate = block.get(name, {}).get(grasp_type)
    return "-" if rate is None else f"{scale * rate:.1f}"


def _interval(block: Mapping[str, Mapping[str, Sequence[float]]], name: str, grasp_type: str) -> str:
    low, high = block[name][grasp_type]
    return f"({100 * low:.0f}-{100 * high:.0f})"
