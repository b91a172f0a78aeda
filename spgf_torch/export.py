"""`python -m spgf_torch.export format=...`: a trial table as a data set in formats of other programs."""

from __future__ import annotations

from pathlib import Path

from spgf_torch.cli.command import run_command
from spgf_torch.extras import needed
from spgf_torch.files.given_paths import check_folder
from spgf_torch.files.writing import check_place
from spgf_torch.formats.config import ExportConfig, wanted_formats
from spgf_torch.paths import find
from spgf_torch.progress import ProgressReporter, show


def run(config: ExportConfig, folder: Path) -> None:
    """Write the wanted formats into `out` (default: `dataset` in the run's folder), all of them or nothing."""
    formats = wanted_formats(config.format)
    if "acronym" in formats:
        needed("format: acronym", "h5py")
    check_place("out", config.out)
    check_folder("trials", config.trials, "the trial tables that simulate leaves")
    check_folder("objects", config.objects, "a folder of meshes or descriptions")

    from spgf_torch.formats.folder import check_out, replacing
    from spgf_torch.formats.read_trials import read_trial_set
    from spgf_torch.formats.write_datasets import files_table, rates_table, write_formats

    out = Path(config.out).expanduser() if config.out else folder / "dataset"
    check_out(out, config.overwrite, [find(config.trials), find(config.objects), Path.cwd()])
    stages = ProgressReporter()
    trials = read_trial_set(config, stages)
    for note in trials.notes:
        show(note)
    with replacing(out) as part:
        known = write_formats(part, trials, formats, config, stages)
    show(rates_table(known))
    show(files_table(out))
    show(f"{', '.join(formats)} in {out}; what is where: {out / 'README.md'}")


if __name__ == "__main__":
    run_command("export", ExportConfig, run)
