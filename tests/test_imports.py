"""Rooms that need only torch load nothing heavy, so that a ROS node starts in a second."""

import subprocess
import sys

import pytest

HEAVY = ("sapien", "lightning", "hydra", "matplotlib", "pytorch_kinematics", "trimesh")


@pytest.mark.parametrize(
    "module",
    ["geometry.se3", "geometry.neighbours", "features.spgf", "prototypes.kmeans", "affordance.voting"],
)
def test_torch_only_rooms_load_nothing_heavy(module: str) -> None:
    code = f"import sys, spgf_torch.{module}; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_trial_tables_are_read_without_sapien() -> None:
    code = "import sys, spgf_torch.trials.table, spgf_torch.experiment.tried; print('sapien' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "False"
