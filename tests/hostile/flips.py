"""Every kind of file that is read again, one of each, and single bits of them changed: shared with `bit_flips.py`."""

from __future__ import annotations

import json
import random
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "tests/reporting"))
from report_runs import tiny_model, train_config, write_run  # noqa: E402

from spgf_torch.affordance.model import load_model, save_model  # noqa: E402
from spgf_torch.baselines.checkpoints import read_checkpoint, read_tensors, write_checkpoint, write_tensors  # noqa: E402
from spgf_torch.errors import InputError  # noqa: E402
from spgf_torch.experiment.held_out import load_fold_models  # noqa: E402
from spgf_torch.experiment.labelled_grasps import _made_with  # noqa: E402
from spgf_torch.files.digests import SUMS, sealed_json, sealed_yaml  # noqa: E402
from spgf_torch.formats.card import CARD, check_card, checksums  # noqa: E402
from spgf_torch.reporting.data.predictions import predictions_of  # noqa: E402
from spgf_torch.reporting.data.runs import read_per_object, read_run  # noqa: E402
from spgf_torch.simulation.run_state import RunState  # noqa: E402
from spgf_torch.simulation.table import read_table, write_table  # noqa: E402


@dataclass(frozen=True)
class Kind:
    """A file, and how it is read again."""

    path: Path
    read: Callable[[], Any]


def kinds(folder: Path) -> dict[str, Kind]:
    """One file of every kind that carries a digest, or is listed with one."""
    run, model, old = write_run(folder / "run"), folder / "run", folder / "old"
    old.mkdir()
    for name in ("apple.parquet", "config.yaml", SUMS):
        shutil.copy(ROOT / "data/trials" / name, old)
    new = folder / "new.parquet"
    write_table(new, read_table(old / "apple.parquet"))
    settings = folder / "config.yaml"
    settings.write_bytes(sealed_yaml("candidates: 1000\nseed: 0\n"))
    write_checkpoint(folder / "best.ckpt", {"origin": "o", "state_dict": {"a": torch.rand(40)}})
    write_tensors(folder / "judged.safetensors", {"logit": torch.rand(40)})
    (folder / "set").mkdir()
    (folder / "set/README.md").write_text("a data set")
    (folder / "set" / CARD).write_bytes(sealed_json({"schema": 1, "files": checksums(folder / "set")}, indent=1))
    made_with = {
        "hand_digest": "h",
        "sampler": {},
        "episode": {},
        "candidates": 3,
        "seed": 0,
        "versions": {"sapien": "3"},
    }
    (folder / "run_state").mkdir()
    run_state = RunState(folder / "run_state", (1, 1), made_with, types=2)
    run_state.write_manifest()
    folds = held_out(folder / "held")
    return {
        "model.safetensors": Kind(model / "model.safetensors", lambda: load_model(model)),
        "model.json": Kind(model / "model.json", lambda: load_model(model)),
        "predictions.parquet": Kind(run / "predictions.parquet", lambda: predictions_of(read_run(run), "log_odds")),
        "results.json": Kind(run / "results.json", lambda: read_run(run)),
        "config.yaml of a run": Kind(run / "config.yaml", lambda: read_run(run)),
        "per_object.csv": Kind(run / "per_object.csv", lambda: read_per_object(read_run(run))),
        "trial table": Kind(new, lambda: read_table(new)),
        "trial table as committed": Kind(old / "apple.parquet", lambda: read_table(old / "apple.parquet")),
        "config.yaml as committed": Kind(old / "config.yaml", lambda: _made_with(old / "config.yaml")),
        "config.yaml of trials": Kind(settings, lambda: _made_with(settings)),
        "manifest.json": Kind(run_state.path, run_state._read_manifest),
        "best.ckpt": Kind(folder / "best.ckpt", lambda: read_checkpoint(folder / "best.ckpt")),
        "judged.safetensors": Kind(folder / "judged.safetensors", lambda: read_tensors(folder / "judged.safetensors")),
        "card.json": Kind(folder / "set" / CARD, lambda: check_card(folder / "set")),
        "file of a data set": Kind(folder / "set/README.md", lambda: check_card(folder / "set")),
        "objects.json": Kind(folds / "fold_models/objects.json", lambda: load_fold_models(folds)),
    }


def held_out(run: Path) -> Path:
    """A run with the models of two folds."""
    for fold in (0, 1):
        (run / "fold_models" / str(fold)).mkdir(parents=True)
        save_model(tiny_model(3, train_config(3)), run / "fold_models" / str(fold))
    listed = {"egg": {"fold": 0, "digest": "a"}, "mug": {"fold": 1, "digest": "b"}}
    (run / "fold_models/objects.json").write_bytes(sealed_json(listed, indent=1, sort_keys=True))
    return run


def accepted(kind: Kind, count: int, seed: int = 0, most: int = 1 << 62) -> Iterator[str]:
    """The flips, of `count` random ones, that are not refused in one line; the file is whole again afterwards."""
    whole = kind.path.read_bytes()
    rng = random.Random(seed)
    bits = [*range(min(8 * len(whole), most)), *range(max(0, 8 * len(whole) - most), 8 * len(whole))]
    try:
        for bit in (rng.choice(bits) for _ in range(count)):
            changed = bytearray(whole)
            changed[bit // 8] ^= 1 << bit % 8
            kind.path.write_bytes(changed)
            try:
                kind.read()
            except InputError as error:
                if "\n" in str(error) or "expected" not in str(error) or not names(kind, str(error)):
                    yield f"bit {bit}: {error}"
            except Exception as error:
                yield f"bit {bit}: {type(error).__name__}: {error}"
            else:
                yield f"bit {bit} of {len(whole)} bytes"
    finally:
        kind.path.write_bytes(whole)


def names(kind: Kind, line: str) -> bool:
    """Whether the line names the file; of a pair both may be damaged."""
    pair = {"model.json": "model.safetensors"}.get(kind.path.name, kind.path.name)
    return kind.path.name in line or pair in line


def sums_accepted(folder: Path) -> list[str]:
    """The flips of a whole list of digests, bit by bit, that let its file be read."""
    table, listed = folder / "apple.parquet", folder / SUMS
    line = next(line for line in listed.read_text().splitlines() if line.endswith("apple.parquet"))
    listed.write_text(line + "\n")
    kind = Kind(listed, lambda: read_table(table))
    whole, found = listed.read_bytes(), []
    for bit in range(8 * len(whole)):
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << bit % 8
        listed.write_bytes(changed)
        try:
            kind.read()
        except InputError:
            continue
        found.append(f"bit {bit}: {json.dumps(changed.decode(errors='replace'))}")
    listed.write_bytes(whole)
    return found
