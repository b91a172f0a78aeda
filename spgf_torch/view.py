"""`python -m spgf_torch.view input=FOLDER model=FOLDER`: frames of a folder as they come, with grasps."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from pathlib import Path
from threading import Event

from spgf_torch.cli.command import run_command
from spgf_torch.extras import needed
from spgf_torch.files.given_paths import check_files, check_folder, model_and_judge
from spgf_torch.progress import ProgressReporter, show
from spgf_torch.viewing.config import ViewConfig


def run(config: ViewConfig, folder: Path) -> None:
    """Show frames until a signal comes; `folder` keeps the settings alone.

    Raises InputError for a folder or a model that there is not, and where the extra is missing.
    """
    needed("the page", "viser")
    model_and_judge(config.model, config.judge)
    if not Path(config.input).is_dir():
        check_folder("input", config.input, "a folder to watch")
    for name in ("intrinsics", "poses", "mask", "segments"):
        if getattr(config, name) is not None:
            check_files(config, name)

    import viser

    from spgf_torch.predictor import Predictor
    from spgf_torch.viewing.shown import Page
    from spgf_torch.viewing.watching import watch

    with ProgressReporter().stage("model", 1, "model") as advance:
        model = Predictor.load(config.model, config.device, config.proposing, config.retreat, config.judge).ready()
        advance(1)
    with redirect_stdout(io.StringIO()):  # which it tells of itself all the same
        server = viser.ViserServer(config.host, config.port, label="spgf view", verbose=False)
    try:
        show(f"watching {config.input} at http://{config.host}:{server.get_port()}; Ctrl-C ends it")
        watch(config, model, Page(server, model, config.N * len(model.grippers)), show, Event())
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()


if __name__ == "__main__":
    run_command("view", ViewConfig, run)
