"""`python -m spgf_torch.generate count=1000 seed=0 out=FOLDER`: household objects drawn from ranges of sizes."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from uuid import uuid4

import yaml

from spgf_torch.cli.command import run_command
from spgf_torch.errors import InputError
from spgf_torch.files.writing import check_place
from spgf_torch.objects.config import CLASSES, GenerateConfig
from spgf_torch.progress import ProgressReporter, show

if TYPE_CHECKING:
    from spgf_torch.objects.families import Drawn
    from spgf_torch.objects.grasp_object import GraspObject

PICTURE, ABOUT = "contact_sheet.png", "README.md"


def run(config: GenerateConfig, folder: Path) -> None:
    """Draw all objects, then write them into `out` (default: `objects` in the run's folder): all of them or nothing.

    Raises InputError for ranges that make no objects and for a folder in which there is something.
    """
    check_place("out", config.out)

    from spgf_torch.objects.families import draw, read_families, turns
    from spgf_torch.paths import find

    if config.lightest >= config.heaviest:
        raise InputError(f"lightest: expected less than heaviest, {config.heaviest:g} kg, got {config.lightest:g}")
    out = Path(config.out).expanduser() if config.out else folder / "objects"
    _check_out(out)
    families, stages = read_families(find(config.ranges), config.families), ProgressReporter()
    texts, masses = {ABOUT: ""}, (config.lightest, config.heaviest)
    pictured: list[GraspObject] = []
    of_family: Counter[str] = Counter()
    of_class: Counter[str] = Counter()
    with stages.stage("drawing", config.count, "objects") as advance:
        for name, number in turns(list(families), config.count, config.seed):
            drawn = draw(name, families[name], number, config.seed, masses)
            texts[f"{drawn.description.name}.yaml"] = _text(drawn)
            pictured += [drawn.built] if len(pictured) < config.pictured else []
            of_family[name] += 1
            of_class[drawn.description.category] += 1
            advance(1)
    texts[ABOUT] = _about(of_family, config)
    _write(out, texts, pictured, stages)
    told = ", ".join(f"{of_class[category]} {category}" for category in CLASSES if of_class[category])
    show(f"{config.count} objects of {len(families)} families ({told}) in {out}")


def _check_out(out: Path) -> None:
    try:
        got = "one that is not empty" if out.is_dir() and any(out.iterdir()) else ""
    except OSError as error:
        got = str(error.strerror)
    if got:
        raise InputError(f"out: expected a new or an empty folder, got {out}, {got}")


def _write(out: Path, texts: Mapping[str, str], pictured: Sequence[GraspObject], stages: ProgressReporter) -> None:
    """Write beside `out` first, then rename: there is never a folder with some of the objects."""
    from spgf_torch.files.writing import sync
    from spgf_torch.objects.contact_sheet import contact_sheet

    out = out.absolute()
    out.parent.mkdir(parents=True, exist_ok=True)
    part = out.with_name(f".{uuid4().hex}.part")
    try:
        part.mkdir()
        for name, content in texts.items():
            (part / name).write_text(content, encoding="utf-8")
        if pictured:
            with stages.stage("picture", len(pictured), "objects") as advance:
                contact_sheet(pictured, part / PICTURE)
                advance(len(pictured))
        part.rename(out)
        sync(out.parent)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def _text(drawn: Drawn) -> str:
    """The file of a description: what it stands for, then its keys."""
    values = yaml.safe_dump(drawn.values, sort_keys=False, default_flow_style=None, width=1000)
    return f"# {drawn.product}, drawn by python -m spgf_torch.generate (README.md)\n{values}"


def _about(counts: Mapping[str, int], config: GenerateConfig) -> str:
    """What the folder holds and how it was made."""
    from spgf_torch.files.digests import digest_of
    from spgf_torch.paths import find

    families = f" families=[{','.join(config.families)}]" if config.families else ""
    rows = "\n".join(f"| {name} | {count} |" for name, count in sorted(counts.items()))
    return (
        f"# {config.count} household objects drawn from ranges of sizes\n\n"
        f"    python -m spgf_torch.generate count={config.count} seed={config.seed} ranges={config.ranges}{families}"
        f" lightest={config.lightest:g} heaviest={config.heaviest:g} out=FOLDER\n\n"
        f"SHA-256 of the ranges: {digest_of(find(config.ranges))}.\n\n"
        "A name is family, seed, number in the family; an object depends on these and its family's ranges, not on how\n"
        "many were drawn. No product was measured. Whether a hand can hold one is for `simulate` to say.\n\n"
        f"| family | objects |\n|---|---|\n{rows}\n"
    )


if __name__ == "__main__":
    run_command("generate", GenerateConfig, run)
