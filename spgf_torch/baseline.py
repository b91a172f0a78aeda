"""`python -m spgf_torch.baseline`: a network that judges grasps from sensed points, in the experiment of `train`."""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from spgf_torch.affordance.config import NESTED
from spgf_torch.baselines.config import BaselineConfig, check_network
from spgf_torch.cli.command import run_command
from spgf_torch.extras import installed, remedy
from spgf_torch.files.given_paths import check_folder
from spgf_torch.progress import ProgressReporter, console, show

NO_PROTOTYPES = 0  # the K of a network


def run(config: BaselineConfig, folder: Path) -> None:
    """Train a network a fold on the samples of an export, score grasps on novel objects; write results and networks."""
    check_network(config.network)
    check_folder("export", config.export, "the folder of a data set (python -m spgf_torch.export format=webdataset)")
    check_folder("objects", config.objects, "a folder of meshes or descriptions")
    check_folder("trials", config.trials, "the trial tables that simulate leaves")

    from spgf_torch.baselines.data import provenance_of, read_data, usable_device
    from spgf_torch.baselines.work_folder import claimed, hand_over

    device, start, stages = usable_device(config.device), time.perf_counter(), ProgressReporter()
    data = read_data(config, device, stages)
    provenance = provenance_of(data, config)

    from spgf_torch.baselines.costs import costs  # brings Lightning: seconds, not before the input is known to be good
    from spgf_torch.baselines.folds import predictions_of, run_folds
    from spgf_torch.evaluation.files import write_per_object, write_results
    from spgf_torch.evaluation.results import build_results
    from spgf_torch.evaluation.tables import calibration_lines, chosen_line, results_table

    if not installed("tensorboard"):
        console.print(f"baseline: logs as CSV alone; for others: {remedy('tensorboard')}")
    with claimed(Path(config.checkpoints).expanduser(), provenance) as work:
        logits = run_folds(data, config, work, provenance, stages)
        predictions = predictions_of(data, logits, config.N)
        described: Any = SimpleNamespace(**vars(config), K=NO_PROTOTYPES, classwise=False)
        results = build_results(predictions, described, data.digest)
        results["costs"] = costs(data, logits, config, work, stages.seconds["reading"])
        write_per_object(folder / "per_object.csv", predictions, config.N)
        seconds = {**stages.seconds, "total": time.perf_counter() - start}
        write_results(folder, {**results, "seconds": seconds})
        hand_over(work, folder)
    table = results_table(results, list(dict.fromkeys([config.ranking, NESTED])))
    table.title = f"Success-rate (%) of a network's {config.N} highest-ranked grasps on novel objects"
    for content in (table, chosen_line(results), *calibration_lines(results)):
        show(content)
    show(f"results, networks, logs and settings in {folder}")


if __name__ == "__main__":
    run_command("baseline", BaselineConfig, run)
