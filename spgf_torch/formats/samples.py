"""Ready training samples, a trial each, in WebDataset shards that stream without this package.

`fold{F}-{NNN}.tar` holds samples of objects that are novel in fold F, in random order: train on the shards of the other
folds. A sample has two files:

    KEY.cloud.npy   (P, 3) float32, m: sensed points about the grasp in the frame of its TCP (+z approach, +x closing)
    KEY.json        {"type": ..., "label": 0 or 1, "outcome": ..., "object": ..., "class": ..., "fold": F, "index": i}

KEY is OBJECT_TYPE_i; i is the row of the object's trial table.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.checks import entry, name
from spgf_torch.files.reading import json_of, unreadable
from spgf_torch.formats import tar
from spgf_torch.formats.config import SamplesConfig
from spgf_torch.formats.trial_sets import TrialSet
from spgf_torch.objects.config import CLASSES
from spgf_torch.simulation.table import OUTCOMES

CLOUD, ABOUT = "cloud.npy", "json"
SOFT = 0.01  # m; nearer than this no point is likelier than another: the sensed points stand 5 mm apart
CHUNK = 500  # grasps whose clouds are made at once: 500 x 3000 points take 70 MB


@dataclass(frozen=True)
class Sample:
    """A sample as a shard has it; `cloud` is (P, 3) float32, m, frame tcp."""

    key: str
    cloud: np.ndarray
    type: str
    label: int
    outcome: str
    object: str
    category: str
    fold: int
    index: int


def shard_name(fold: int, number: int) -> str:
    return f"fold{fold}-{number:03d}.tar"


def write_samples(
    folder: Path, trials: TrialSet, config: SamplesConfig, seed: int, advance: Callable[[int], None]
) -> None:
    """Write every trial as a sample; `advance` is called with the number of samples just written."""
    folder.mkdir(parents=True)
    for fold in np.unique(trials.fold).tolist():
        members = np.flatnonzero(trials.fold == fold).tolist()
        rows = [np.arange(len(trials.tables[i])) for i in members]
        pairs = np.column_stack([np.repeat(members, [len(r) for r in rows]), np.concatenate(rows)])
        pairs = np.random.default_rng([seed, fold]).permutation(pairs)
        for number, first in enumerate(range(0, len(pairs), config.per_shard)):
            chosen = pairs[first : first + config.per_shard]
            rng = np.random.default_rng([seed, fold, number])
            clouds = _clouds(trials, chosen, config, rng)
            header = _npy_header(clouds[0])
            with tar.written(folder / shard_name(fold, number)) as shard:
                for (i, row), cloud in zip(chosen.tolist(), clouds, strict=True):
                    about = _about(trials, i, row)
                    key = f"{about['object']}_{about['type']}_{row}"
                    tar.add(shard, f"{key}.{CLOUD}", header + cloud.tobytes())
                    tar.add(shard, f"{key}.{ABOUT}", json.dumps(about).encode())
            advance(len(chosen))


def grasp_clouds(
    points: np.ndarray, T_object_tcp: np.ndarray, config: SamplesConfig, rng: np.random.Generator
) -> np.ndarray:
    """The cloud of each grasp, (G, P, 3) float32 in the frame of its TCP.

    Of the points within `radius` of the TCP, P are drawn without replacement, the likelier the nearer they are
    (weight 1 / d^2): evenly drawn, most of them would lie where no finger comes. Fewer than P are repeated in turn; if
    there is none, the nearest point is taken alone.

    Args:
        points: (N, 3) m, object frame. T_object_tcp: (G, 4, 4). rng: draws the points.
    """
    R, t = T_object_tcp[:, :3, :3].astype(np.float64), T_object_tcp[:, None, :3, 3]
    local = ((points[None] - t) @ R).astype(np.float32)
    squared = (local**2).sum(axis=2)
    inside = squared <= np.maximum(config.radius**2, squared.min(axis=1))[:, None]
    # Exponential times at a rate of the weight: the first P to ring are a draw without replacement.
    rings = rng.standard_exponential(squared.shape, dtype=np.float32) * np.maximum(squared, SOFT**2)
    rings[~inside] = np.inf
    kept = min(config.points, len(points))
    order = np.argpartition(rings, kept - 1, axis=1)[:, :kept]
    order = np.take_along_axis(order, np.take_along_axis(rings, order, 1).argsort(1), 1)  # all inside come first
    count = np.minimum(inside.sum(axis=1), kept)
    repeat = np.arange(config.points)[None] % count[:, None]
    return np.take_along_axis(local, np.take_along_axis(order, repeat, 1)[:, :, None], 1)


def read_samples(path: Path) -> Iterator[Sample]:
    """The samples of one shard. Raises InputError in one line for a shard that is missing, cut off or has others."""
    for key, files in tar.samples(path):
        where = f"{path}: {key}"
        about = json_of(entry(files, ABOUT, where), Path(where), "what is known of a sample")
        yield Sample(key, _cloud(entry(files, CLOUD, where), where), *_checked_about(about, where))


def _clouds(trials: TrialSet, chosen: np.ndarray, config: SamplesConfig, rng: np.random.Generator) -> np.ndarray:
    """(len(chosen), P, 3) of pairs (object, row), made object by object."""
    clouds = np.empty((len(chosen), config.points, 3), np.float32)
    for i in np.unique(chosen[:, 0]):
        at = np.flatnonzero(chosen[:, 0] == i)
        poses, points = trials.tables[i].T_object_tcp.numpy(), trials.texlets[i].positions.numpy()
        for first in range(0, len(at), CHUNK):
            part = at[first : first + CHUNK]
            clouds[part] = grasp_clouds(points, poses[chosen[part, 1]], config, rng)
    return clouds


def _about(trials: TrialSet, i: int, row: int) -> dict[str, Any]:
    table, obj = trials.tables[i], trials.objects[i]
    return {
        "type": trials.grasp_types[int(table.grasp_type[row])],
        "label": int(table.success[row]),
        "outcome": OUTCOMES[int(table.outcome[row])],
        "object": obj.name,
        "class": obj.category,
        "fold": int(trials.fold[i]),
        "index": row,
    }


def _npy_header(cloud: np.ndarray) -> bytes:
    """What stands before the numbers in a .npy file of this shape: the same for all clouds."""
    buffer = io.BytesIO()
    np.save(buffer, cloud, allow_pickle=False)
    return buffer.getvalue()[: -cloud.nbytes]


def _cloud(content: bytes, where: str) -> np.ndarray:
    """The array of a .npy; its header is believed only as far as there are bytes."""
    stream = io.BytesIO(content)
    try:
        version = np.lib.format.read_magic(stream)
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    except ValueError as error:
        raise unreadable(Path(where), f"{CLOUD}, a .npy file", error) from None
    rest = content[stream.tell() :]
    if version != (1, 0) or dtype != np.float32 or fortran or len(shape) != 2 or shape[1] != 3:
        raise InputError(f"{where}: {CLOUD}: expected (P, 3) float32, got {shape} {dtype}")
    if len(rest) != shape[0] * 3 * dtype.itemsize:
        raise InputError(f"{where}: {CLOUD}: expected {shape[0]} points, got {len(rest)} bytes")
    cloud = np.frombuffer(rest, np.float32).reshape(shape)
    if not np.isfinite(cloud).all():
        raise InputError(f"{where}: {CLOUD}: expected finite points, got NaN or infinite ones")
    return cloud


def _checked_about(about: Any, where: str) -> tuple[str, int, str, str, str, int, int]:
    values = [entry(about, key, where) for key in ("type", "label", "outcome", "object", "class", "fold", "index")]
    name(values[0], f"{where}: type")
    known = ((0, 1), OUTCOMES, None, CLASSES)
    for key, value, options in zip(("label", "outcome", "object", "class"), values[1:], known, strict=False):
        if options is not None and (value not in options or isinstance(value, bool)):
            raise InputError(f"{where}: {key}: expected one of {', '.join(map(str, options))}; got {value!r:.40}")
    return tuple(values)  # type: ignore[return-value]
