"""`python -m spgf_torch.simulate`: candidate grasps on objects, each tried in SAPIEN: the trial table."""

from __future__ import annotations

from pathlib import Path

from omegaconf import OmegaConf

from spgf_torch.cli import door
from spgf_torch.config import InputError, SimulateConfig, plain
from spgf_torch.progress import Stages, show


def run(config: SimulateConfig, folder: Path) -> None:
    """Write one Parquet file an object into `out` (default: the run's folder); finished ones are kept."""
    from spgf_torch.evaluation.tables import random_rates
    from spgf_torch.objects.folders import read_objects
    from spgf_torch.trials.hand import load_hand
    from spgf_torch.trials.runner import Trials, origin, simulate
    from spgf_torch.trials.table import read_table, read_tables, table_path, write_table

    out = Path(config.out) if config.out else folder
    _make_folder(out)
    stages = Stages()
    found = read_objects(config, stages)
    objects = found.objects
    for note in found.notes:
        show(note)
    trials = Trials(load_hand(config.hand), config.episode)
    waiting = []
    for obj in objects:
        path = table_path(out, obj.name)
        if not path.exists():
            waiting.append(obj)
        else:
            read_tables(out, [origin(obj, trials, config.sampler, config.candidates, config.seed)])
    (out / "config.yaml").write_text(OmegaConf.to_yaml(OmegaConf.create(plain(config))))
    total = 2 * config.candidates * len(waiting)
    with stages.stage("trials", total, "candidates") as advance:
        tables = simulate(
            waiting, trials, config.sampler, config.candidates, config.seed, config.workers, lambda _, n: advance(n)
        )
        for table in tables:
            write_table(table_path(out, table.object_name), table)
    made = [read_table(table_path(out, obj.name)) for obj in objects]
    show(random_rates([obj.category for obj in objects], [t.success for t in made], [t.grasp_type for t in made]))
    if waiting:
        show(f"{total / stages.seconds['trials']:.0f} candidates/s")
    show(f"{len(objects)} files in {out}")


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"out: expected a folder that can be made, got {out} ({error.strerror})") from error


if __name__ == "__main__":
    door("simulate", SimulateConfig, run)
