"""What `train` costs with many objects: processor time and memory of the command, its cache off.

    python tests/benchmarks/many_objects.py [COUNT ...] [KEY=VALUE ...]     # 50, 100 and 200 objects

The objects are those of `generate seed=0`, with a thousand candidates of each type on each, as `simulate` samples them.
Their outcomes are NOT simulated: each is drawn at random, a success in four, since costs alone are measured here and
they hardly depend on outcomes. So no rate of these runs means anything. Other keys are given to `train`, as K=20 or
runner=dask address=tcp://HOST:8786; processor time and memory are then those of the calling process alone. The
digest is the beginning of the SHA-256 of the model and of what was predicted, to compare runs by.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import torch
from omegaconf import OmegaConf

from spgf_torch.files.digests import sealed_yaml
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.objects.library import load_objects
from spgf_torch.settings import plain, settings
from spgf_torch.simulation.config import EpisodeConfig, SamplerConfig, samplers_of
from spgf_torch.simulation.execute import provenance_of, sample, table_of
from spgf_torch.simulation.table import OUTCOMES, table_path, write_table
from spgf_torch.simulation.worker import Trials

CANDIDATES, SEED, SUCCESS = 1000, 0, 0.25
COUNTS = (50, 100, 200)


def make(folder: Path, count: int) -> None:
    """Objects, and tables with outcomes at random."""
    run("generate", folder, f"count={count}", f"seed={SEED}", "out=objects", "pictured=0")
    hand = settings(HandConfig)
    trials, sampler = Trials(load_hand(hand), settings(EpisodeConfig)), settings(SamplerConfig)
    (folder / "trials").mkdir()
    for obj in load_objects(folder / "objects"):
        its = provenance_of(obj, trials, sampler, CANDIDATES, SEED)
        poses = sample(obj, its, samplers_of(hand))
        held = np.random.default_rng(zlib.crc32(obj.name.encode())).random(len(poses.position)) < SUCCESS
        outcome = torch.from_numpy(np.where(held, OUTCOMES.index("success"), OUTCOMES.index("missed")))
        write_table(table_path(folder / "trials", obj.name), table_of(its, poses, outcome))
    made: dict[str, Any] = {"candidates": CANDIDATES, "seed": SEED, "hand": plain(hand)}
    (folder / "trials/config.yaml").write_bytes(sealed_yaml(OmegaConf.to_yaml(OmegaConf.create(made))))


def run(command: str, folder: Path, *keys: str) -> tuple[float, float, float]:
    """Processor seconds, seconds and largest memory (GB) of a command of the package, run in `folder`."""
    call = [sys.executable, "-m", f"spgf_torch.{command}", *keys]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    start = time.perf_counter()
    with (folder / f"{command}.log").open("w") as log:
        done = subprocess.Popen(call, cwd=folder, env=environment, stdout=log, stderr=log)
        _, status, used = os.wait4(done.pid, 0)
    if status:
        sys.exit(f"{' '.join(call[1:])}\n{(folder / f'{command}.log').read_text()[-3000:]}")
    return used.ru_utime + used.ru_stime, time.perf_counter() - start, used.ru_maxrss / 1e6 * 1.024


def main(arguments: list[str]) -> None:
    """A line a count."""
    keys = [argument for argument in arguments if "=" in argument]
    counts = [int(argument) for argument in arguments if "=" not in argument] or list(COUNTS)
    print(f"{'objects':>8} {'processor s':>12} {'s':>8} {'GB':>6} {'model MB':>9}   {'digest':16}   seconds of stages")
    for count in counts:
        with tempfile.TemporaryDirectory(prefix="spgf-many-") as name:
            folder = Path(name)
            make(folder, count)
            used, taken, memory = run("train", folder, "objects=objects", "trials=trials", "cache=off", *keys)
            results = json.loads((folder / "outputs/train/latest/results.json").read_text())
            size = results.get("costs", {}).get("model_bytes", 0) / 1e6
            stages = ", ".join(f"{stage} {seconds:.0f}" for stage, seconds in results["seconds"].items())
            print(
                f"{count:8d} {used:12.1f} {taken:8.1f} {memory:6.2f} {size:9.1f}   {stages}   {digest(folder)}",
                flush=True,
            )


def digest(folder: Path) -> str:
    """Of model and predictions of the latest run."""
    sha = hashlib.sha256()
    for name in ("model.safetensors", "predictions.parquet"):
        sha.update((folder / "outputs/train/latest" / name).read_bytes())
    return sha.hexdigest()[:16]


if __name__ == "__main__":
    main(sys.argv[1:])
