"""Rooms that need only torch load nothing heavy, so that a ROS node starts in a second; tables need no simulator."""

import subprocess
import sys

HEAVY = ("sapien", "lightning", "hydra", "matplotlib", "pytorch_kinematics", "trimesh")
LIGHT = (
    "geometry.se3",
    "geometry.neighbours",
    "features.spgf",
    "prototypes.kmeans",
    "prototypes.search",
    "affordance.voting",
)


def loaded(modules: tuple[str, ...], heavy: tuple[str, ...]) -> list[str]:
    """Which of the heavy packages the modules bring, imported one after the other in a fresh process."""
    code = (
        "import importlib, sys\n"
        f"for name in {modules!r}:\n"
        "    importlib.import_module('spgf_torch.' + name)\n"
        f"    print(*[name + ' loads ' + m for m in {heavy!r} if m in sys.modules], sep='\\n')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.split("\n")


def test_torch_only_rooms_load_nothing_heavy() -> None:
    assert not any(loaded(LIGHT, HEAVY))


def test_trial_tables_are_read_without_sapien() -> None:
    assert not any(loaded(("trials.table", "trials.runner", "experiment.tried"), ("sapien",)))
