"""python tests/endurance/kill_simulate.py [KILLS [SEED]]: the command `simulate` itself, killed at random moments.

Three objects, physics and all. A call is a process group with its workers; SIGKILL ends it as a whole, after a time
that is drawn between 0 and what an uninterrupted call takes; the next call goes on, and so on until KILLS (30) were
killed. Then tables are compared, byte for byte, with those of the uninterrupted call. Ten minutes on two idle cores;
not part of the suite, which kills calls without physics (tests/simulation/test_kills.py).
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
NAMES = ("mug_coffee", "egg", "box_tea")
CANDIDATES = 40


def start(folder: Path, out: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "spgf_torch.simulate", "objects=objects", f"out={out}", "chunk=10"]
    return subprocess.Popen(
        [*command, f"candidates={CANDIDATES}"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def rows(out: Path) -> dict[tuple[str, int], str]:
    """(object, row) -> outcome, of what is on disk; every file of it can be read."""
    import pyarrow.parquet as pq

    found: dict[tuple[str, int], str] = {}
    for name in NAMES:
        for path in (out / "shards" / name).glob("[0-9]*.json"):
            content = json.loads(path.read_bytes())
            found |= {(name, content["first"] + i): word for i, word in enumerate(content["outcomes"])}
        if (out / f"{name}.parquet").exists():
            words = pq.read_table(out / f"{name}.parquet")["outcome"].to_pylist()
            found |= {(name, i): word for i, word in enumerate(words)}
    return found


def main() -> None:
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    rng = random.Random(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    found = {"kills": 0, "in the middle": 0, "lost": 0, "other": 0, "overstated": 0, "tables": 0, "different": 0}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "objects").mkdir()
        for name in NAMES:
            shutil.copy(ROOT / f"data/objects/{name}.yaml", folder / "objects")
        begun = time.perf_counter()
        assert start(folder, "whole").wait() == 0
        span = time.perf_counter() - begun
        whole = {path.name: path.read_bytes() for path in (folder / "whole").glob("*.parquet")}
        known: dict[tuple[str, int], str] = {}
        number = 0
        while True:
            out = folder / f"out{number}"
            call = start(folder, out.name)
            last = found["kills"] == kills
            try:
                call.wait(None if last else rng.uniform(0, span))
                assert call.returncode == 0, call.stderr.read().decode()
            except subprocess.TimeoutExpired:
                os.killpg(call.pid, signal.SIGKILL)
                call.wait()
                found["kills"] += 1
            now = rows(out)
            found["in the middle"] += call.returncode != 0 and 0 < len(now) < 2 * CANDIDATES * len(NAMES)
            found["lost"] += len(known.keys() - now.keys())
            found["other"] += sum(now[key] != word for key, word in known.items() if key in now)
            manifest = out / "manifest.json"
            found["overstated"] += manifest.exists() and json.loads(manifest.read_bytes())["trials"] > len(now)
            print(f"{found['kills']} kills, {len(now)} trials on disk", file=sys.stderr, flush=True)
            known = now
            if call.returncode == 0:
                tables = {path.name: path.read_bytes() for path in out.glob("*.parquet")}
                found["tables"] += len(tables)
                found["different"] += tables != whole
                number, known = number + 1, {}
                if last:
                    break
    print(json.dumps({**found, "seconds uninterrupted": round(span, 1)}))


if __name__ == "__main__":
    main()
