"""Makes `tests/` importable, where what files of several sub-packages share stands; what takes longest begins first.

A file is run by one process as a whole (`--dist=loadfile`), files in the order of collection
(`--no-loadscope-reorder`): begun last, a long one would leave the other process with nothing to do.
"""

from pathlib import Path

import pytest

# Files of more than some six seconds of processor, the longest first (pytest -n 0 FILE --durations=0).
LONGEST = (
    "test_experiment_commands.py",
    "test_serve_command.py",
    "test_tutorials.py",
    "test_judging.py",
    "test_judged_commands.py",
    "test_docs.py",
    "test_kills.py",
    "test_report_command.py",
    "test_launchers.py",
    "test_own_trials.py",
    "test_recorded_training.py",
    "test_few_objects.py",
    "test_folders.py",
    "test_scene_learning.py",
    "test_panda.py",
    "test_clutter_command.py",
    "test_doctests.py",
    "test_imports.py",
    "test_simulate_command.py",
    "test_dask.py",
    "test_worker.py",
    "test_cluster.py",
    "test_spgf.py",
    "test_terminal.py",
    "test_run_folder.py",
    "test_baseline_command.py",
    "test_golden.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    place = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(Path(item.path).name, len(place)))
