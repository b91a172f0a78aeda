"""python tests/endurance/trials_memory.py [TRIALS [WORKERS [EPISODE]]]: memory, time and bytes of many trials.

10,000 candidates on ten of the objects, by two processes, with episode=pinch, into a temporary folder as `simulate`
does it. Prints, after every tenth, the resident memory of the caller and of the largest worker; then what plans of more
are made from (docs/CLUSTERS.md): candidates a second, and a second of processor time of workers, which other work on
the machine disturbs less; bytes of tables and of shards; time to write a shard.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from pathlib import Path

from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import root
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.config import EpisodeConfig, SamplerConfig
from spgf_torch.simulation.execute import made_with, provenance_of
from spgf_torch.simulation.executors import ProcessExecutor
from spgf_torch.simulation.generation import Generation, Plan
from spgf_torch.simulation.run_state import RunState
from spgf_torch.simulation.worker import Trials

CHUNK = 50
TICK = os.sysconf("SC_CLK_TCK")


class Timed(RunState):
    """Says how long its shards took and how large they were."""

    seconds, bytes_, shards = 0.0, 0, 0

    def add(self, provenance, first, poses, outcomes) -> None:
        start = time.perf_counter()
        super().add(provenance, first, poses, outcomes)
        self.seconds += time.perf_counter() - start
        self.shards += 1
        name = f"{first:08d}-{first + len(outcomes):08d}.json"
        self.bytes_ += (self.folder / "shards" / provenance.object_name / name).stat().st_size


def resident(process: int | str) -> float:
    """MB."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1e3
    return 0.0


def processor_seconds(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def children() -> list[int]:
    tasks = Path(f"/proc/{os.getpid()}/task").glob("*/children")
    return [int(child) for path in tasks for child in path.read_text().split()]


def main() -> None:
    total = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    workers = int(sys.argv[2]) if len(sys.argv) > 2 else 2
    name = sys.argv[3] if len(sys.argv) > 3 else "pinch"
    with initialize_config_dir(str(root() / "conf"), version_base="1.3"):
        composed = compose("simulate", [f"episode={name}"])
    episode = typed(EpisodeConfig, OmegaConf.to_container(composed.episode))
    begun = time.process_time()
    objects = load_objects(root() / "data/objects")
    reading = 1e3 * (time.process_time() - begun) / len(objects)
    objects = objects[::5]
    candidates = total // (2 * len(objects))
    trials, sampler = Trials(load_hand(settings(HandConfig)), episode), settings(SamplerConfig)
    pairs = [(obj, provenance_of(obj, trials, sampler, candidates, 0)) for obj in objects]
    done, told, spent, begun = 0, 0, 0.0, time.perf_counter()
    lines: list[dict[str, float]] = []

    def progress(count: int) -> None:
        nonlocal done, told, spent
        done += count
        spent = max(spent, sum(map(processor_seconds, children())))
        if done - told >= total // 10:
            told = done
            lines.append(
                {"candidates": done, "caller MB": resident("self"), "worker MB": max(map(resident, children()))}
            )
            print(json.dumps(lines[-1]), file=sys.stderr, flush=True)

    with tempfile.TemporaryDirectory() as temporary:
        run_state = Timed(Path(temporary), (1, 1), made_with(trials, sampler, candidates, 0))
        with run_state.open([its for _, its in pairs]):
            Generation(run_state, Plan(trials, CHUNK), progress).run(pairs, ProcessExecutor(workers))
        seconds = time.perf_counter() - begun
        tables = sum(path.stat().st_size for path in Path(temporary).glob("*.parquet"))
    found = {
        "candidates": done,
        "workers": workers,
        "candidates/s": done / seconds,
        "candidates/s of processor time": done / spent,
        "worker MB after a tenth": lines[0]["worker MB"],
        "worker MB at the end": lines[-1]["worker MB"],
        "caller MB after a tenth": lines[0]["caller MB"],
        "caller MB at the end": lines[-1]["caller MB"],
        "table bytes/candidate": tables / done,
        "shard bytes/candidate": run_state.bytes_ / done,
        "ms to read an object": reading,
        "ms/shard": 1e3 * run_state.seconds / run_state.shards,
    }
    print(json.dumps({key: round(value, 2) for key, value in found.items()}, indent=1))


if __name__ == "__main__":
    main()
