"""Calls killed at 30 random moments: nothing that was on disk is lost or tried again, and the tables are the same."""

import json
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from spgf_torch.hands.hand import Hand

HERE = Path(__file__).parent
MEMORY = Path("/dev/shm")


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """In memory where there is such a place: a killed process loses nothing there that it would keep on a disk."""
    if not os.access(MEMORY, os.W_OK):
        yield tmp_path
        return
    with TemporaryDirectory(dir=MEMORY) as made:
        yield Path(made)


def test_thirty_kills(hand: Hand, folder: Path) -> None:
    (folder / "hand.pkl").write_bytes(pickle.dumps(hand))
    done = subprocess.run(
        [sys.executable, str(HERE / "killing.py"), str(folder), "30", "0", str(folder / "hand.pkl")],
        env={**os.environ, "PYTHONPATH": str(HERE.parents[1]), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert done.returncode == 0 and not done.stderr, done.stderr
    found = json.loads(done.stdout)
    toys, physics = found["toys"], found["physics"]
    assert toys["kills"] == 30 and toys["cut off"] >= 10  # most in the middle of the work
    assert [toys[what] for what in ("lost", "twice", "overstated", "different")] == [0] * 4
    assert physics["kills"] and 0 < physics["kept"] < 40 and not physics["different"]
    assert physics["ran"] <= 40 - physics["kept"]
