"""Calls killed at 30 random moments: nothing that was on disk is lost or tried again, and the tables are the same."""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

from spgf_torch.hands.hand import Hand

HERE = Path(__file__).parent


def test_thirty_kills(hand: Hand, tmp_path: Path) -> None:
    (tmp_path / "hand.pkl").write_bytes(pickle.dumps(hand))
    done = subprocess.run(
        [sys.executable, str(HERE / "killing.py"), str(tmp_path), "30", "0", str(tmp_path / "hand.pkl")],
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
