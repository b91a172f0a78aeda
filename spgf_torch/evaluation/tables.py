"""What people see in the terminal: ours beside the paper and beside chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from spgf_torch.config import CLASSES, GRASP_TYPES
from spgf_torch.evaluation import paper
from spgf_torch.evaluation.success import class_means, random_rate

Block = Mapping[str, Mapping[str, float]]


def results_table(results: Mapping[str, Any]) -> Table:
    """Table 1's row for this K: ours by every ranking with 95 % intervals, the paper's, chance, ceiling; in percent."""
    K = results["K"]
    table = _empty(f"Success-rate (%) of the {results['N']} highest-ranked grasps on novel objects, K = {K}")
    if K in paper.SUCCESS_RATE:
        table.add_row("paper", *_cells(paper.SUCCESS_RATE[K], scale=1))
    for ranking, block in results["by_ranking"].items():
        table.add_row(f"ours, {ranking}", *_cells(block))
        table.add_row("  95 % interval", *_intervals(results["interval95_by_ranking"][ranking]), end_section=True)
    table.add_row("random, paper", *_cells(paper.RANDOM, scale=1))
    table.add_row("random, ours", *_cells(results["random"]))
    table.add_row("random, no sensed collision", *_cells(results["random_collision_free"]))
    table.add_row("ceiling", *_cells(results["ceiling"]))
    return table


def random_rates(classes: Sequence[str], success: Sequence[Any], grasp_type: Sequence[Any]) -> Table:
    """Chance in a trial table beside the paper's: of each object its class, success (G,) bool, type (G,) int."""
    rates = [random_rate(np.asarray(held), np.asarray(kind)) for held, kind in zip(success, grasp_type, strict=True)]
    ours = class_means(classes, [{kind: rate[kind] for kind in GRASP_TYPES} for rate in rates])
    table = _empty("Success-rate (%) of a random candidate", GRASP_TYPES)
    table.add_row("paper", *_cells(paper.RANDOM, GRASP_TYPES, scale=1))
    table.add_row("this table", *_cells(ours, GRASP_TYPES))
    return table


def executed_table(results: Mapping[str, Any]) -> Table:
    """Per object and class: the share of the best grasps that SAPIEN held, beside random candidates; in percent."""
    table = Table(title=f"Held in SAPIEN (%): the {results['N']} highest-ranked grasps, and random candidates")
    table.add_column("object")
    table.add_column("class")
    for name in ("NPG", "WPG", "CG", "random NPG", "random WPG", "random CG"):
        table.add_column(name, justify="right")
    kinds = ("NPG", "WPG", "CG")
    for row in results["per_object"]:
        rates = [row[kind] for kind in kinds] + [row["random"][kind] for kind in kinds]
        table.add_row(row["object"], row["class"], *(f"{100 * rate:.1f}" for rate in rates))
    table.add_section()
    for name, block in results["success_rate"].items():
        rates = [block[kind] for kind in kinds] + [results["random"][name][kind] for kind in kinds]
        table.add_row("mean", name, *(f"{100 * rate:.1f}" for rate in rates))
    low, high = results["interval95"]["all"]["CG"]
    table.caption = f"CG, all: 95 % interval over objects {100 * low:.0f} to {100 * high:.0f} %"
    return table


def _empty(title: str, kinds: Sequence[str] = ("NPG", "WPG", "CG")) -> Table:
    table = Table(title=title, padding=0, box=box.SIMPLE_HEAD)
    table.add_column("", no_wrap=True)
    for name in (*CLASSES, "all"):
        for kind in kinds:
            label = {"containers": "cont", "boxes": "box", "curved": "curv"}.get(name, name)
            table.add_column(f"{label}\n{kind}", justify="right", no_wrap=True)
    return table


def _cells(block: Block, kinds: Sequence[str] = ("NPG", "WPG", "CG"), scale: float = 100) -> list[str]:
    rates = [block.get(name, {}).get(kind) for name in (*CLASSES, "all") for kind in kinds]
    return ["-" if rate is None else f"{scale * rate:.1f}" for rate in rates]


def _intervals(block: Mapping[str, Mapping[str, Sequence[float]]]) -> list[str]:
    bounds = [block.get(name, {}).get(kind) for name in (*CLASSES, "all") for kind in ("NPG", "WPG", "CG")]
    return ["-" if b is None else f"{100 * b[0]:.0f}-{100 * b[1]:.0f}" for b in bounds]
