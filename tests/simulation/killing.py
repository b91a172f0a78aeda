"""python tests/simulation/killing.py FOLDER KILLS SEED HAND: generations killed at random moments, again and again.

One process imports everything and forks the calls, so that a kill costs a fraction of a second. A call is a process
group of its own together with the processes that try; SIGKILL ends it as a whole, the next one goes on in its folder
until one comes through, and so on in a new folder until KILLS calls were killed. Then one more, with physics: a can and
the hand that is pickled in HAND. Prints what was found as JSON.
"""

from __future__ import annotations

import json
import os
import pickle
import random
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))

from generations import Calls, manifest, tables
from toys import TRIALS, Toy, checksum, toss
from trial_objects import can

import spgf_torch.simulation.run_state as run_state_module
from spgf_torch.settings import settings
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.execute import sample
from spgf_torch.simulation.executors import InlineExecutor, ProcessExecutor
from spgf_torch.simulation.table import read_table
from spgf_torch.simulation.worker import Trials

CANDIDATES = 40


def killed(call: Callable[[], object], wait: Callable[[], object] | None) -> bool:
    """Fork a call into a group of its own; whether it was still running after `wait`, and was killed.

    Without `wait` it may run to its end.
    """
    child = os.fork()
    if child == 0:
        os.setpgid(0, 0)
        try:
            call()
        except BaseException as error:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
            os._exit(3)
        os._exit(0)
    os.setpgid(child, child)
    if wait is not None:
        wait()
    if os.waitpid(child, 0 if wait is None else os.WNOHANG) != (0, 0):
        return False
    os.killpg(child, signal.SIGKILL)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


def durable(out: Path, calls: Calls) -> dict[str, list[str | None]]:
    """What files in the folder say of each object's rows; every one of them can be read."""
    rows: dict[str, list[str | None]] = {}
    for obj in calls.objects:
        rows[obj.name] = [None] * (2 * calls.candidates)
        for path in sorted((out / "shards" / obj.name).glob("[0-9]*.json")):
            content = json.loads(path.read_bytes())
            rows[obj.name][content["first"] : content["first"] + len(content["outcomes"])] = content["outcomes"]
        if (out / f"{obj.name}.parquet").exists():
            read_table(out / f"{obj.name}.parquet")
            rows[obj.name] = ["done"] * (2 * calls.candidates)
    return rows


def toys_killed(folder: Path, kills: int, rng: random.Random) -> dict[str, int]:
    """How often calls were killed, and what was lost, tried again although it was on disk, or different in the end."""
    names = ("a", "b", "c")
    plain = Calls([Toy(name) for name in names], TRIALS, toss, CANDIDATES)
    plain.make(folder / "whole", InlineExecutor())
    marks = {}
    for obj in plain.objects:
        T = sample(obj, plain.provenance(obj), TRIALS.samplers).T_object_tcp(0, 2 * CANDIDATES)
        marks.update({checksum(T[row]): (obj.name, row) for row in range(len(T))})
    timed = Calls([Toy(name, seconds=0.001) for name in names], TRIALS, toss, CANDIDATES)
    start = time.perf_counter()
    killed(lambda: timed.make(folder / "timed", ProcessExecutor(1), chunk=7), None)
    span = time.perf_counter() - start
    found = {"kills": 0, "lost": 0, "twice": 0, "overstated": 0, "different": 0, "tables": 0, "cut off": 0}
    while found["kills"] < kills:
        number = found["tables"] // len(names)
        out, log = folder / str(number), folder / f"{number}.log"
        calls = Calls([Toy(name, log=str(log), seconds=0.001) for name in names], TRIALS, toss, CANDIDATES)
        known: dict[str, list[str | None]] = {name: [None] * (2 * CANDIDATES) for name in names}
        while killed(
            lambda calls=calls, out=out: calls.make(out, ProcessExecutor(1), chunk=7),
            (lambda: time.sleep(rng.uniform(0, span))) if found["kills"] < kills else None,
        ):
            found["kills"] += 1
            now = durable(out, calls)
            found["lost"] += sum(b is None for name in names for a, b in zip(known[name], now[name], strict=True) if a)
            tried = [marks[int(line.split()[2])] for line in log.read_text().splitlines()] if log.exists() else []
            found["twice"] += sum(known[name][row] is not None for name, row in tried)
            log.unlink(missing_ok=True)
            told = manifest(out)["trials"] if (out / "manifest.json").exists() else 0
            there = sum(word is not None for rows in now.values() for word in rows)
            found["overstated"] += told > there
            found["cut off"] += 0 < there < 2 * CANDIDATES * len(names)
            known = now
        found["tables"] += len(names)
        found["different"] += tables(out) != tables(folder / "whole")
    return found


def physics_killed(folder: Path, hand: Path, rng: random.Random) -> dict[str, int]:
    """One call killed soon after its first shard, one to the end of it, and a whole one."""
    trials = Trials(pickle.loads(hand.read_bytes()), settings(EpisodeConfig))
    calls = Calls([can()], trials, None, 20)

    def wait() -> None:
        while not list((folder / "out/shards/can").glob("[0-9]*.json")):
            time.sleep(0.01)
        time.sleep(rng.uniform(0, 0.3))

    kills = killed(lambda: calls.make(folder / "out", ProcessExecutor(1), chunk=5), wait)
    kept = manifest(folder / "out")["trials"]
    _, ran = calls.make(folder / "out", InlineExecutor(), chunk=5)
    calls.make(folder / "whole", InlineExecutor())
    different = tables(folder / "out") != tables(folder / "whole")
    return {"kills": kills, "kept": kept, "ran": ran, "different": different}


def main() -> None:
    folder, kills, seed, hand = sys.argv[1:]
    run_state_module.EVERY = 0.0  # a manifest after every shard: it can be killed there too
    rng = random.Random(int(seed))
    found = {
        "toys": toys_killed(Path(folder) / "toys", int(kills), rng),
        "physics": physics_killed(Path(folder) / "physics", Path(hand), rng),
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
