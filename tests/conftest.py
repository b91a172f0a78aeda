"""Makes `tests/` importable, where what files of several sub-packages share stands; what takes longest begins first.

A file is run by one process as a whole (`--dist=loadfile`), files in the order of collection
(`--no-loadscope-reorder`): begun last, a long one would leave the other process with nothing to do.
"""

import gc
import os
from pathlib import Path

import pytest
from longest import LONGEST

gc.disable()  # modules and tests stay: looking for garbage among them would be a fifth of the collection
# Each process has its share of the cores: threads beyond it would wait for each other. What is about threads sets them.
if others := int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", 0)):
    os.environ.setdefault("OMP_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // others)))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    place = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(Path(item.path).name, len(place)))


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()
