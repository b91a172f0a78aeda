"""What making a model small costs where votes alone propose: the best grasps of whole and small models, executed.

    python tests/benchmarks/shipped_proposals.py [--scans=FOLDER] [RUN...]     RUN: a folder of train fold_models=true

Each fold's model proposes for the library's objects that it has not seen, and that of all objects for the meshes in
FOLDER, with judge=none: where a judge ranks, proposals are the same to the bit. CG in percent, intervals over objects.
Without a RUN one is made.
"""

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import json
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from shared.harness import Report
from shipped import WHOLE, made

from spgf_torch.affordance.model import load_model, save_model
from spgf_torch.affordance.small_config import SmallConfig
from spgf_torch.experiment.held_out import FOLDER
from spgf_torch.settings import settings

ROOT = Path(__file__).parents[2]
RESAMPLES = 10_000


def small_copy(run: Path, place: Path) -> Path:
    """The run with its models small, those of folds by the same share of points as that of all objects."""
    usual = settings(SmallConfig)
    (place / FOLDER).mkdir(parents=True)
    shutil.copy(run / FOLDER / "objects.json", place / FOLDER)
    for folder in sorted(path.parent for path in (*run.glob("model.json"), *run.glob(f"{FOLDER}/*/model.json"))):
        model, there = load_model(folder), place / folder.relative_to(run)
        there.mkdir(exist_ok=True)
        share = usual.points if folder == run else round(len(model.condensed.cell) * usual.points / WHOLE)
        save_model(model, there, settings(SmallConfig, points=share))
    return place


def executed(model: Path, folder: Path, *given: str) -> dict[str, float]:
    """Object -> CG of its best grasps, in percent."""
    words = [f"model={model}/", "judge=none", "random_trials=1", f"hydra.run.dir={folder}", *given]
    subprocess.run([sys.executable, "-m", "spgf_torch", "evaluate", *words], cwd=ROOT, check=True)
    rows = json.loads((folder / "results.json").read_text())["per_object"]
    return {row["object"]: 100 * row["CG"] for row in rows}


def compare(what: str, whole: dict[str, float], small: dict[str, float], report: Report) -> None:
    gain = np.array([small[name] - whole[name] for name in whole])
    drawn = np.random.default_rng(0).choice(gain, (RESAMPLES, len(gain))).mean(1)
    low, high = np.percentile(drawn, [2.5, 97.5])
    words = f"{np.mean(list(whole.values())):.1f} whole, {np.mean(list(small.values())):.1f} small, "
    report.figure(what, "within 0.5", f"{words}{gain.mean():+.1f} ({low:+.1f} to {high:+.1f})")
    for name in whole:
        report.row(what=what, object=name, whole=whole[name], small=small[name])


def main(words: list[str]) -> None:
    report = Report("shipped_proposals", "Grasps that votes alone propose, of whole and of small models, executed.")
    scans = next((Path(word.partition("=")[2]).resolve() for word in words if word.startswith("--scans=")), None)
    runs = [Path(word).resolve() for word in words if not word.startswith("--")]
    with TemporaryDirectory() as name:
        place = Path(name)
        for number, run in enumerate(runs or [made(place / "run", whole=True)]):
            small = small_copy(run, place / f"small_{number}")
            cases = {"held-out objects": ["held_out=true", "objects=data/objects"]}
            if scans is not None and (run / "model.json").is_file():
                cases[scans.name] = [f"objects={scans}"]
            elif scans is not None:
                report.skip(f"{scans.name}: {run.name} has no model of all objects (final_model=false)")
            for what, given in cases.items():
                found = [executed(each, place / f"{number}_{what}_{each.name}", *given) for each in (run, small)]
                compare(f"proposals by votes alone, {what}, {run.name}", *found, report)
    report.write()


if __name__ == "__main__":
    main(sys.argv[1:])
