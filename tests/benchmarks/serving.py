"""A warm prediction through `spgf serve`, on real sockets: a cloud of 12,000 points, one client, then eight at once.

    python tests/benchmarks/serving.py [model=FOLDER]

Processor seconds are those of server and predicting process together, from the system's own count; wall seconds are the
client's, and mean something on a quiet machine alone. Start-up and memory are told beside. The cloud is that of
prediction.py's `one`: an object of the library, 1 mm of noise, normals of its faces.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from prediction import scene
from shared.harness import Report

from spgf_torch.serving.client import Client

ROUNDS, CLIENTS = 16, 8
# Where the machine is busy, waiting is no error.
OPTIONS = ("port=0", "quiet=true", "wait_seconds=600", "seconds=600")
TICKS = os.sysconf("SC_CLK_TCK")


def family(process: int) -> list[int]:
    """A process and those that it started."""
    own = [process]
    for each in Path(f"/proc/{process}/task").glob("*/children"):
        for child in each.read_text().split():
            own += family(int(child))
    return own


def busy(process: int) -> float:
    """Processor seconds of a process and those that it started."""
    fields = [Path(f"/proc/{each}/stat").read_text().rpartition(")")[2].split() for each in family(process)]
    return sum(int(field) for of_one in fields for field in of_one[11:13]) / TICKS


def memory(process: int) -> list[int]:
    """MB of each, the server first."""
    lines = [Path(f"/proc/{each}/status").read_text().splitlines() for each in family(process)]
    return [int(line.split()[1]) // 1000 for of_one in lines for line in of_one if line.startswith("VmRSS:")]


def main() -> None:
    model = next((word.partition("=")[2] for word in sys.argv[1:] if word.startswith("model=")), "panda")
    cloud = scene("one", np.random.default_rng(0))
    file = np.hstack([cloud.points, cloud.normals]).astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "cloud.npy", file)
        start = time.perf_counter()
        command = [
            sys.executable,
            "-m",
            "spgf_torch",
            "serve",
            f"model={Path(model).resolve() if '/' in model else model}",
            *OPTIONS,
        ]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=folder) as process:
            try:
                assert process.stdout is not None
                url = next(word for word in process.stdout.readline().split() if word.startswith("http"))
                ready, used = time.perf_counter() - start, busy(process.pid)
                measure(Client(url.rstrip(","), 600), Path(folder) / "cloud.npy", process.pid, (ready, used))
            finally:
                process.send_signal(signal.SIGINT)


def measure(client: Client, file: Path, process: int, start: tuple[float, float]) -> None:
    """Ask one after the other, then all at once, and print."""

    def ask(_: int) -> tuple[float, str]:
        begun = time.perf_counter()
        grasps = client.grasps(file=file)["grasps"]
        return time.perf_counter() - begun, json.dumps(grasps)

    for i in range(3):
        ask(i)
    before = busy(process)
    alone = [ask(i) for i in range(ROUNDS)]
    each = (busy(process) - before) / ROUNDS
    begun = time.perf_counter()
    with ThreadPoolExecutor(CLIENTS) as pool:
        together = list(pool.map(ask, range(ROUNDS)))
    wall = (time.perf_counter() - begun) / ROUNDS
    assert {grasps for _, grasps in (*alone, *together)} == {alone[0][1]}, "other grasps"
    alone_wall = float(np.median([seconds for seconds, _ in alone]))
    used = memory(process)
    report = Report("serving", "A warm prediction through spgf serve on a cloud of 12,000 points, over real sockets.")
    report.figure("start to ready", "", f"{start[0]:.1f} s, {start[1]:.1f} s of processor")
    report.figure("memory of the server and of the predicting process", "", f"{used[0]} and {max(used[1:])} MB")
    report.figure("a prediction through the server", "<= 0.25 s", f"{alone_wall:.3f} s, {each:.3f} s of processor")
    report.figure(f"{CLIENTS} clients at once", "same grasps, no error", f"the same; {wall:.3f} s a prediction")
    report.row(ready=start[0], ready_busy=start[1], wall=alone_wall, busy=each, wall_at_once=wall)
    report.write()


if __name__ == "__main__":
    main()
