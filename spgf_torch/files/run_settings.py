"""`config.yaml` in the folder of a run: its settings, all of them."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import yaml

SETTINGS = "config.yaml"


def write_settings(folder: Path, config: Any) -> None:
    """The settings of a run, a dataclass, into its folder."""
    settings = yaml.safe_dump(asdict(config), sort_keys=False, allow_unicode=True, width=float("inf"))
    (folder / SETTINGS).write_text(settings, encoding="utf-8")
