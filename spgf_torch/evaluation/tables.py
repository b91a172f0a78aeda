"""What people see in the terminal: ours beside the paper and beside chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.table import Table

from spgf_torch.affordance.config import JUDGE, NESTED
from spgf_torch.evaluation import paper
from spgf_torch.evaluation.results import KNOWS_MORE, chosen_words
from spgf_torch.evaluation.success import TYPES, class_means, random_rate
from spgf_torch.hands.config import GRASP_TYPES
from spgf_torch.objects.config import CLASSES

SHORT = {"containers": "cont"}  # as in the paper's Table 1: the table fits 80 columns

if TYPE_CHECKING:
    from spgf_torch.objects.scans import Scan

Block = Mapping[str, Mapping[str, float]]


def results_table(results: Mapping[str, Any], rankings: Sequence[str] | None = None) -> Table:
    """Table 1 for this K, in percent: the paper's rate, ours by two rankings with 95 % intervals, chance, ceiling.

    A row a class that occurs and type, so that it fits 80 columns. Where each class was learned by itself, the rates
    printed beside ours are those of the paper's row [*], Thomsen et al. (2015).

    Args:
        rankings: at most two; None: `paper` and `nested`, or where a judge ranked `nested` and `judge`.
    """
    K = results["K"]
    rankings = rankings or ((NESTED, JUDGE) if JUDGE in results["by_ranking"] else ("paper", NESTED))
    classwise = bool(results.get("classwise"))
    printed = paper.CLASSWISE if classwise else paper.SUCCESS_RATE.get(K, {})
    table = Table(
        title=f"Success-rate (%) of the {results['N']} highest-ranked grasps on novel objects, K = {K}"
        + (", each class by itself" if classwise else ""),
        caption=f"(low-high): 95 % interval over objects, of one seed ({results['seed']}). {paper.OTHER_DATA} "
        + (f"{KNOWS_MORE} " if NESTED in rankings else "")
        + "free: candidates without a sensed collision.",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        padding=(0, 0, 0, 1),
        pad_edge=False,
    )
    table.add_column("", no_wrap=True)
    named = {"paper": "paper's\nranking", NESTED: "our rank-\ning, nested"}
    headings = ["[*]\n2015" if classwise else "the\npaper", *(named.get(r, f"ours\n{r}") for r in rankings)]
    for heading in [*headings, "random\npaper", "random\nours", "random\nfree", "ceil-\ning"]:
        table.add_column(heading, justify="right", no_wrap=True)
    for name in (name for name in (*CLASSES, "all") if name in results["by_ranking"][rankings[0]]):
        for grasp_type in TYPES:
            ours = [
                f"{_percent(results['by_ranking'][ranking], name, grasp_type)} "
                f"{_interval(results['interval95_by_ranking'][ranking], name, grasp_type)}"
                for ranking in rankings
            ]
            table.add_row(
                f"{SHORT.get(name, name)} {grasp_type}",
                _percent(printed, name, grasp_type, scale=1),
                *ours,
                _percent(paper.RANDOM, name, grasp_type, scale=1),
                *(
                    _percent(results[block], name, grasp_type)
                    for block in ("random", "random_collision_free", "ceiling")
                ),
                end_section=grasp_type == TYPES[-1],
            )
    return table


def chosen_line(results: Mapping[str, Any]) -> str:
    """Which ranking the training folds chose, in a line."""
    return f"nested: the ranking chosen inside the training folds: {chosen_words(results['chosen'])}"


def calibration_line(results: Mapping[str, Any]) -> str:
    """Expected calibration error of each type, in a line."""
    blocks = results["calibration"].items()
    told = ", ".join(f"{name} {block['ece']:.3f} (as voted {block['ece_before']:.3f})" for name, block in blocks)
    return f"expected calibration error of the probabilities: {told}"


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


def random_rates(classes: Sequence[str], success: Sequence[Any], grasp_type: Sequence[Any]) -> Table:
    """Chance in a trial table beside the paper's: of each object its class, success (G,) bool, type (G,) int."""
    rates = [random_rate(*map(np.asarray, columns)) for columns in zip(success, grasp_type, strict=True)]
    ours = class_means(classes, [{name: rate[name] for name in GRASP_TYPES} for rate in rates])
    table = Table("", "paper", "this table", title="Success-rate (%) of a random candidate", box=box.SIMPLE_HEAD)
    for row in ((category, name) for category in ours for name in GRASP_TYPES):
        table.add_row(" ".join(row), _percent(paper.RANDOM, *row, scale=1), _percent(ours, *row))
    return table


def executed_table(results: Mapping[str, Any]) -> Table:
    """Per object and class: the share of the best grasps that SAPIEN held, beside random candidates; in percent."""
    table = Table(title=f"Held in SAPIEN (%): the {results['N']} highest-ranked grasps, and random candidates")
    table.add_column("object")
    table.add_column("class")
    for name in ("NPG", "WPG", "CG", "random NPG", "random WPG", "random CG"):
        table.add_column(name, justify="right")
    for row in results["per_object"]:
        rates = [block[grasp_type] for block in (row, row["random"]) for grasp_type in TYPES]
        table.add_row(row["object"], row["class"], *(f"{100 * rate:.1f}" for rate in rates))
    table.add_section()
    for name, block in results["success_rate"].items():
        rates = [its[grasp_type] for its in (block, results["random"][name]) for grasp_type in TYPES]
        table.add_row("mean", name, *(f"{100 * rate:.1f}" for rate in rates))
    low, high = results["interval95"]["all"]["CG"]
    table.caption = f"CG, all: 95 % interval over objects {100 * low:.0f} to {100 * high:.0f} %"
    return table


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


def _percent(block: Block, name: str, grasp_type: str, scale: float = 100) -> str:
    rate = block.get(name, {}).get(grasp_type)
    return "-" if rate is None else f"{scale * rate:.1f}"


def _interval(block: Mapping[str, Mapping[str, Sequence[float]]], name: str, grasp_type: str) -> str:
    low, high = block[name][grasp_type]
    return f"({100 * low:.0f}-{100 * high:.0f})"
