"""What judges tried in scenes, as one table: a Parquet file from which a judge is learned again without physics.

A row says in which scene and cloud the grasp was proposed, in which round, by whom, at which place among the best, and
how it ended. Poses are rebuilt from what is stored before they are tried, as everywhere.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import torch
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.files.digests import check_seal
from spgf_torch.files.parquet import parquet_table
from spgf_torch.files.reading import json_of, unreadable
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.scene_benches import KINDS
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.proposing.hypotheses import Hypotheses
from spgf_torch.settings import plain
from spgf_torch.simulation.attempts import CAUSES
from spgf_torch.simulation.columns import codes_in, dictionary, floats
from spgf_torch.simulation.execute import versions
from spgf_torch.simulation.table import POSITION, QUATERNION, check_poses, pose_matrix, write_columns
from spgf_torch.simulation.worker import Trials

SCHEMA = 1
FILE = "scene_trials.parquet"
KEY = b"spgf_torch.scene_trials"  # of the metadata in the Parquet schema
WHAT = "a table of trials in scenes"
MOST_ROWS = 1_000_000
WHOLE = {"scene": np.int32, "cloud": np.int8, "round": np.int8, "rank": np.int16}
# Who proposed: judges that learned from single objects, judges that learned in scenes, or nobody.
PROPOSERS = ("object judge", "scene judge", "random")
COLUMNS = ("kind", "by", "type", *POSITION, *QUATERNION, "cause", *WHOLE, "probability")


@dataclass(frozen=True)
class SceneTrials:
    """Grasps that were tried in scenes.

    Attributes:
        scene (M,) int64: seeds. kind (M,) int64: into `KINDS`. cloud (M,) int64: of the scene's clouds.
        round (M,) int64: from 1; the one after the last measures. by (M,) int64: into `PROPOSERS`.
        rank (M,) int64: place among the best of its cloud, from 0; -1: at random.
        position (M, 3), quaternion (M, 4) f32, grasp_type (M,) int64: in the world.
        cause (M,) int64: into `attempts.CAUSES`; 0 is success. probability (M,) f32: as who proposed said.
    """

    scene: Tensor
    kind: Tensor
    cloud: Tensor
    round: Tensor
    by: Tensor
    rank: Tensor
    position: Tensor
    quaternion: Tensor
    grasp_type: Tensor
    cause: Tensor
    probability: Tensor

    def __len__(self) -> int:
        return len(self.scene)

    def at(self, chosen: Tensor) -> SceneTrials:
        """Those of the mask (M,) bool."""
        return SceneTrials(*(getattr(self, part.name)[chosen] for part in fields(self)))

    @staticmethod
    def together(parts: Sequence[SceneTrials]) -> SceneTrials:
        """All of them, one after the other."""
        return SceneTrials(*(torch.cat([getattr(part, f.name) for part in parts]) for f in fields(SceneTrials)))

    def with_causes(self, cause: Tensor) -> SceneTrials:
        """The same with how they ended (M,) int64."""
        return replace(self, cause=cause)

    @property
    def poses(self) -> Hypotheses:
        """As they were tried."""
        return Hypotheses(pose_matrix(self.position, self.quaternion), self.grasp_type)

    @property
    def success(self) -> Tensor:
        """(M,) bool."""
        return self.cause == CAUSES.index("none")


def origin_of(objects: Sequence[GraspObject], trials: Trials, config: JudgeConfig) -> dict[str, Any]:
    """What a table depends on, as plain values: objects, hand, physics, who proposes how, and how it is sensed."""
    choice = {key: getattr(config, key) for key in ("folds", "seed", "lowest_deg", "highest_deg")}
    return {
        "objects": {obj.name: obj.digest for obj in objects},
        "hand_digest": trials.hand.digest,
        "episode": plain(trials.episode),
        "judging": choice,
        "sensing": plain(config.sensing),
        "context": plain(config.context),
    }


def write_scene_trials(folder: Path, trials: SceneTrials, origin: dict[str, Any], grasp_types: tuple[str, ...]) -> None:
    """Write the table with its seal, atomically."""
    columns = {
        "kind": dictionary(trials.kind, KINDS),
        "by": dictionary(trials.by, PROPOSERS),
        "type": dictionary(trials.grasp_type, grasp_types),
        **dict(zip(POSITION, trials.position.numpy().T, strict=True)),
        **dict(zip(QUATERNION, trials.quaternion.numpy().T, strict=True)),
        "cause": dictionary(trials.cause, CAUSES),
        **{name: getattr(trials, name).numpy().astype(kind) for name, kind in WHOLE.items()},
        "probability": trials.probability.numpy(),
    }
    about = {"schema": SCHEMA, "origin": origin, "versions": versions()}
    write_columns(folder / FILE, columns, {KEY: json.dumps(about, sort_keys=True)})


def read_scene_trials(path: Path, origin: dict[str, Any], grasp_types: tuple[str, ...]) -> SceneTrials:
    """The table in a file. Raises InputError where it is damaged, or was made from something else than `origin`."""
    if not path.is_file():
        raise InputError(f"{path}: expected {WHAT}, got no such file; make it: judge +context=tabletop leaves {FILE}")
    check_seal(path, WHAT)
    content = parquet_table(path, WHAT, COLUMNS, MOST_ROWS)
    try:
        about = json_of((content.schema.metadata or {}).get(KEY, b"{}"), path, WHAT)
        _check_origin(path, about, origin)
        whole = {name: torch.from_numpy(content[name].to_numpy().astype(np.int64)) for name in WHOLE}
        trials = SceneTrials(
            kind=codes_in(path, content, "kind", KINDS),
            by=codes_in(path, content, "by", PROPOSERS),
            position=floats(content, POSITION),
            quaternion=floats(content, QUATERNION),
            grasp_type=codes_in(path, content, "type", grasp_types),
            cause=codes_in(path, content, "cause", CAUSES),
            probability=floats(content, ("probability",))[:, 0],
            **whole,
        )
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, pa.ArrowException) as error:
        raise unreadable(path, f"the columns of {WHAT}", error, "others") from error
    check_poses(path, trials.position, trials.quaternion)
    return trials


def _check_origin(path: Path, about: dict[str, Any], origin: dict[str, Any]) -> None:
    if about.get("schema") != SCHEMA:
        raise InputError(f"{path}: expected {WHAT} of schema {SCHEMA}, got {about.get('schema', 'another file')}")
    for key, value in origin.items():
        if (got := about["origin"].get(key)) != json.loads(json.dumps(value)):
            other = sorted(k for k in value if value[k] != got.get(k)) if isinstance(value, dict) else [value]
            raise InputError(
                f"{path}: expected trials made with these {key}, got others: {', '.join(map(str, other))[:80]}"
            )
