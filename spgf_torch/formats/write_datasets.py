"""Write all wanted formats of a trial set into one folder, and tabulate what was written."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from spgf_torch.errors import InputError
from spgf_torch.formats.acronym import write_acronym
from spgf_torch.formats.card import card, write_card
from spgf_torch.formats.common import write_common
from spgf_torch.formats.config import FORMATS, ExportConfig
from spgf_torch.formats.graspgen import write_graspgen
from spgf_torch.formats.graspnet import write_graspnet_trials
from spgf_torch.formats.isaac import write_isaac_trials
from spgf_torch.formats.samples import write_samples
from spgf_torch.formats.shards import write_shards
from spgf_torch.formats.trial_sets import TrialSet
from spgf_torch.hands.records import Gripper
from spgf_torch.progress import ProgressReporter

# Formats that describe a gripper by the width of its opening: of two fingers that close on each other.
OF_JAWS = ("acronym", "graspgen", "graspnet")
# Formats that go object by object.
WRITERS: dict[str, Callable[[Path, TrialSet, Callable[[int], None]], None]] = {
    "acronym": write_acronym,
    "graspgen": write_graspgen,
    "isaac": write_isaac_trials,
    "graspnet": write_graspnet_trials,
}


def write_formats(
    folder: Path, trials: TrialSet, formats: Sequence[str], config: ExportConfig, stages: ProgressReporter
) -> dict[str, Any]:
    """Write everything into an empty folder; returns the card.

    Raises InputError where a format for two-finger jaws is asked for, and the hand has a grasp type of another kind.
    """
    check_jaws(trials.grippers.values(), formats)
    objects = len(trials.objects)
    with stages.stage("meshes", objects, "objects") as advance:
        write_common(folder, trials, advance)
    for name in formats:
        if name in WRITERS:
            with stages.stage(name, objects, "objects") as advance:
                WRITERS[name](folder / name, trials, advance)
        else:
            with stages.stage(name, objects * len(trials.grippers), "objects") as advance:
                write_shards(folder / name, trials, advance)
            with stages.stage("samples", trials.trials, "trials") as advance:
                write_samples(folder / name / "samples", trials, config.samples, config.seed, advance)
    known = card(trials, config, formats)
    write_card(folder, known)
    return known


def check_jaws(grippers: Iterable[Gripper], formats: Sequence[str]) -> None:
    """InputError where a format holds two-finger jaws alone, and a gripper is none."""
    others = [gripper for gripper in grippers if not gripper.jaw]
    if others and (narrow := [name for name in formats if name in OF_JAWS]):
        rest = ", ".join(name for name in FORMATS if name not in OF_JAWS)
        raise InputError(
            f"format: expected {rest} for a hand with the grasp type {others[0].type}, which is no two-finger jaw; "
            f"got {narrow[0]}"
        )


def rates_table(known: Mapping[str, Any]) -> Table:
    """Trials and successes of each class and type."""
    table = Table("", title=f"{known['counts']['trials']:,} trials exported", box=box.SIMPLE_HEAD)
    for grasp_type in known["rates"]["all"]:
        for word in ("trials", "held", "%"):
            table.add_column(f"{grasp_type} {word}", justify="right")
    for name, block in known["rates"].items():
        cells = [
            text
            for rate in block.values()
            for text in (f"{rate['trials']:,}", f"{rate['success']:,}", f"{100 * rate['rate']:.1f}")
        ]
        table.add_row(name, *cells)
    return table


def files_table(folder: Path) -> Table:
    """Files and megabytes (1e6 bytes) of each part of the data set."""
    table = Table("", title="Files", box=box.SIMPLE_HEAD)
    for heading in ("files", "MB"):
        table.add_column(heading, justify="right")
    total_files, total = 0, 0
    for part in sorted(path for path in folder.iterdir() if path.is_dir()):
        sizes = [path.stat().st_size for path in part.rglob("*") if path.is_file()]
        total_files, total = total_files + len(sizes), total + sum(sizes)
        table.add_row(part.name, str(len(sizes)), f"{sum(sizes) / 1e6:.1f}")
    rest = [path.stat().st_size for path in folder.iterdir() if path.is_file()]
    table.add_row("all", str(total_files + len(rest)), f"{(total + sum(rest)) / 1e6:.1f}")
    return table
