"""Makes `tests/` importable, where what files of several sub-packages share stands; what takes longest begins first.

A file is run by one process as a whole (`--dist=loadfile`), files in the order of collection
(`--no-loadscope-reorder`): begun last, a long one would leave the other process with nothing to do.
"""

import gc
from pathlib import Path

import pytest
from longest import LONGEST

gc.disable()  # modules and tests stay: looking for garbage among them would be a fifth of the collection


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    place = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(Path(item.path).name, len(place)))


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()
