"""`python -m spgf_torch.serve model=FOLDER`: a model kept warm behind HTTP, for this machine alone by default."""

from __future__ import annotations

from pathlib import Path

from spgf_torch.cli.command import run_command
from spgf_torch.cli.setting_comments import read_settings
from spgf_torch.compiled import loops_kept, loops_wanted
from spgf_torch.extras import needed
from spgf_torch.files.given_paths import model_and_judge
from spgf_torch.paths import root
from spgf_torch.progress import console, show
from spgf_torch.serving.config import ServeConfig


def run(config: ServeConfig, folder: Path) -> None:
    """Serve until a signal comes; `folder` keeps the settings alone.

    Raises InputError for a model that there is not, an address that cannot be had, and where an extra is missing.
    """
    for package in ("starlette", "uvicorn", "python_multipart", "prometheus_client"):
        needed("the server", package)
    model_and_judge(config.model, config.judge)

    from spgf_torch.serving.server import bound, is_own, serve, url

    own = bound(config.host, config.port)
    if not is_own(config.host):
        console.print(f"warning: host={config.host}: whoever reaches this machine there can ask; there is no password")
    reasons = {key.name: key.reason for key in read_settings(root() / "conf/scene/tabletop.yaml").keys}

    if loops_wanted() and not loops_kept():
        show("compiling inner loops, once on this machine: some half a minute")

    def ready() -> None:
        show(f"serving {config.model} at {url(own)}, which {url(own)}/docs describes; Ctrl-C ends it")

    serve(config, own, reasons, ready)


if __name__ == "__main__":
    run_command("serve", ServeConfig, run)
