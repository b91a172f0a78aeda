"""`python -m spgf_torch.pack model=latest name=mine`: a model kept by a name, in few bytes, with all that it needs."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from omegaconf import MISSING

from spgf_torch.affordance.small_config import SmallConfig
from spgf_torch.cli.command import run_command
from spgf_torch.errors import InputError
from spgf_torch.files.given_paths import check_free, check_place, model_and_judge
from spgf_torch.progress import show
from spgf_torch.settings import text


@dataclass
class PackConfig:
    """`python -m spgf_torch.pack`: which model, where to, how small."""

    model: str = text()
    judge: str | None = text()
    name: str | None = text()
    out: str | None = text()
    whole: bool = MISSING
    replace: bool = MISSING
    small: SmallConfig = field(default_factory=SmallConfig)


def run(config: PackConfig, folder: Path) -> None:
    """Write the model's folder, whole or not at all."""
    if (config.name is None) == (config.out is None):
        raise InputError(f"name: expected name=NAME or out=FOLDER, got {'both' if config.name else 'none'}")
    if config.out is not None:
        place = check_free(Path(config.out).expanduser(), config.replace, "out")
    else:
        place = check_place(str(config.name), config.replace)
    rooms = model_and_judge(config.model, config.judge)

    from spgf_torch.proposing.kept_model import keep

    for line in keep(place, rooms, None if config.whole else config.small):
        show(line)


if __name__ == "__main__":
    run_command("pack", PackConfig, run)
