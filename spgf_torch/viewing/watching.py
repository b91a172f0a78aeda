"""The loop of `view`: the newest frame of a folder, its grasps, and the page; until a signal or `stop` ends it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.predictor import Predictor
from spgf_torch.scene.assembly import read_scene
from spgf_torch.viewing.config import ViewConfig
from spgf_torch.viewing.frames import Folder
from spgf_torch.viewing.shown import Page


def watch(config: ViewConfig, model: Predictor, page: Page, say: Callable[[str], None], stop: Event) -> None:
    """Show frames until `stop` is set; what cannot be used is said, and the next is waited for."""
    folder = Folder(Path(config.input))
    while not stop.wait(config.every):
        try:
            path = folder.newest()
        except OSError as error:
            raise InputError(f"input: expected a folder, got {error.strerror} at {config.input}") from None
        if path is None:
            continue
        try:
            say(frame(config, model, page, path))
        except InputError as error:
            page.refuse(path, str(error))
            say(str(error))


def frame(config: ViewConfig, model: Predictor, page: Page, path: Path) -> str:
    """Read a frame, predict and show it; returns a line about it. Raises InputError for a file that cannot be used."""
    start = time.perf_counter()
    scene = read_scene(replace(config, input=str(path)), model.sensing, np.random.default_rng(config.seed))
    grasps = model.predict(scene, config.N)
    seconds = time.perf_counter() - start
    page.show(path, scene, grasps, seconds)
    return f"{path.name}: {len(grasps)} grasps in {seconds:.2f} s"
