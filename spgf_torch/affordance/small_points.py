"""The points of a condensed space in few bytes, for models that travel: some are left out, the others said coarsely.

What few particles support says little and is most of a model, so points of little support are left out, as the paper's
condensation leaves out others. What is left of probability and support is one of a few levels each, a byte for both:
rankings add up hundreds of votes, and what rounding adds to one it takes from another. Probabilities lie evenly by
their square roots, since most are small, supports by their logarithms.

In each partition a byte says how far the next point is, `LEAP` that four others do. Both, and the levels, are deflated.
Nothing that is read can run code or grow beyond what the model says it holds.
"""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.neighbourhood import Condensed
from spgf_torch.affordance.small_config import SmallConfig
from spgf_torch.errors import InputError

STEPS, LEAPS, LEVELS = "cell_steps", "cell_leaps", "levels"
PROBABILITY, SUPPORT = "level_probability", "level_support"
TENSORS = (STEPS, LEAPS, LEVELS, PROBABILITY, SUPPORT)
LEAP = 255  # the step that stands for one too long for a byte
MOST = 40_000_000  # points that are read: four times a full model of the SDH-2, some GB while they are checked
BYTE = 256  # levels at most


def coded(condensed: Condensed, how: SmallConfig) -> dict[str, Tensor]:
    """The tensors that say these points; `slice_start` among them.

    Raises InputError where there are more levels than a byte holds, or the model has no point.
    """
    if (levels := how.probabilities * how.supports) > BYTE:
        raise InputError(f"small.supports: expected {BYTE} levels at most with probabilities, got {levels}")
    support = condensed.support.cpu()
    if not len(support):
        raise InputError("model: expected points to keep, got a model without any")
    kept = support >= _least(support, how.points)
    partition, cell = condensed.partition_of_point().cpu()[kept], condensed.cell.cpu()[kept].long()
    partitions = len(condensed.partition_start) - 1
    counts = torch.bincount(partition, minlength=partitions)
    start = torch.cat([counts.new_zeros(1), counts.cumsum(0)])
    step = np.diff(cell.numpy(), prepend=0) - 1
    first = start[:-1][counts > 0].numpy()
    step[first] = cell.numpy()[first]
    least = max(float(support[kept].min()), 1e-3)
    highest = max(how.most, least)
    p_level = (condensed.probability.cpu()[kept].double().sqrt() * (how.probabilities - 1)).round()
    s_level = (support[kept].double().clamp(least, highest) / least).log()
    s_level = (s_level / max(np.log(highest / least), 1e-9) * (how.supports - 1)).round()
    probabilities = torch.linspace(0, 1, how.probabilities, dtype=torch.float64).square()
    supports = torch.logspace(0, 1, how.supports, highest / least, dtype=torch.float64) * least
    return {
        "slice_start": start,
        STEPS: _deflated(np.minimum(step, LEAP).astype(np.uint8)),
        LEAPS: _deflated(step[step >= LEAP].astype("<i4")),
        LEVELS: _deflated((p_level * how.supports + s_level).numpy().astype(np.uint8)),
        PROBABILITY: probabilities.repeat_interleave(how.supports).float(),
        SUPPORT: supports.repeat(how.probabilities).float(),
    }


def decoded(path: Path, tensors: dict[str, Tensor], cells: int) -> dict[str, Tensor]:
    """`cell` (P,) int32, `probability` and `support` (P,) f32 of the points that the tensors of a file say.

    Raises InputError, which names the file, for what `coded` does not write.
    """
    start = tensors["slice_start"]
    _expect(path, "slice_start", start.ndim == 1 and len(start) > 1 and start.dtype == torch.int64)
    _expect(path, "slice_start", int(start[0]) == 0 and not bool((start.diff() < 0).any()))
    points = int(start[-1])
    if points > MOST:
        raise InputError(f"{path}: expected {MOST} points at most, got {points}")
    steps = np.frombuffer(_inflated(path, STEPS, tensors, points), np.uint8)
    long = steps == LEAP
    leaps = np.frombuffer(_inflated(path, LEAPS, tensors, 4 * int(long.sum())), "<i4")
    _expect(path, LEAPS, not len(leaps) or LEAP <= int(leaps.min()) <= int(leaps.max()) < cells)
    place = steps.astype(np.int32)
    place[long] = leaps
    place += 1
    for first, end in zip(start[:-1].tolist(), start[1:].tolist(), strict=True):
        if first < end:
            place[first] -= 1
            np.cumsum(place[first:end], out=place[first:end])  # what is too far falls again: `check_values` looks
    level = torch.frombuffer(bytearray(_inflated(path, LEVELS, tensors, points)) or bytearray(1), dtype=torch.uint8)
    level, tables = level[:points].int(), (tensors[PROBABILITY], tensors[SUPPORT])
    for name, table in zip((PROBABILITY, SUPPORT), tables, strict=True):
        _expect(path, name, table.ndim == 1 and 0 < len(table) <= BYTE and table.dtype == torch.float32)
        _expect(path, name, not points or int(level.max()) < len(table))
    probability, support = (table.cpu().index_select(0, level) for table in tables)
    return {"cell": torch.from_numpy(place), "probability": probability, "support": support}


def _least(support: Tensor, points: int) -> float:
    """The least support of the points that stay: of all whose support is alike, all stay or none."""
    if len(support) <= points:
        return float(support.min())
    ordered = support.sort(descending=True).values
    least = float(ordered[points - 1])
    return least if least > float(ordered[points]) else float(np.nextafter(np.float32(least), np.float32(np.inf)))


def _deflated(values: np.ndarray) -> Tensor:
    return torch.frombuffer(bytearray(zlib.compress(values.tobytes(), 9)), dtype=torch.uint8)


def _inflated(path: Path, name: str, tensors: dict[str, Tensor], size: int) -> bytes:
    """The `size` bytes that were deflated; InputError for more, fewer, or none."""
    packed = tensors[name]
    _expect(path, name, packed.ndim == 1 and packed.dtype == torch.uint8)
    stream = zlib.decompressobj()
    try:
        content = stream.decompress(packed.cpu().numpy().tobytes(), size + 1)  # one more: it would be too many
    except zlib.error:
        content = b""
    _expect(path, name, len(content) == size and stream.eof and not stream.unused_data)
    return content


def _expect(path: Path, name: str, holds: bool) -> None:
    if not holds:
        raise InputError(f"{path}: expected {name} of a small model as it is written, got something else")
