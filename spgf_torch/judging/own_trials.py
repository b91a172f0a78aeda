"""The trials that judges chose themselves, as tables: one Parquet file an object, from which a judge is learned again.

The columns of a trial table (`trials.table`) and, of each trial, the round and the cloud that it was chosen in, its
place among the best there, and the probability that was said of it. Poses are rebuilt from what is stored before they
are tried, as everywhere: a judge learned from the tables is the one that was learned when they were made, to the bit.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields, replace
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
from spgf_torch.geometry import se3
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.training_rows import PICKED, Chosen
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.proposing.hypotheses import Hypotheses
from spgf_torch.settings import plain
from spgf_torch.simulation.causes import CAUSE_COLUMNS, Causes, has_causes
from spgf_torch.simulation.execute import codes, versions
from spgf_torch.simulation.label import Label
from spgf_torch.simulation.table import (
    COLUMNS,
    MOST_ROWS,
    OUTCOMES,
    POSITION,
    QUATERNION,
    check_poses,
    codes_in,
    columns_of,
    compare,
    floats,
    pose_matrix,
    table_path,
    write_columns,
)
from spgf_torch.simulation.worker import Trials

SCHEMA = 1
KEY = b"spgf_torch.own_trials"  # of the metadata in the Parquet schema
WHAT = "a table of trials that judges chose"
WHOLE = {"round": np.int8, "cloud": np.int16, "rank": np.int16}
# Settings that say which clouds there were, and how many trials of each were chosen.
CHOICE = ("rounds", "best", "random", "one_view", "four_views", "lowest_deg", "highest_deg", "seed")


@dataclass(frozen=True)
class OwnProvenance:
    """What a table was made from.

    Attributes:
        object_name, object_digest, hand_digest, episode: as of a trial table, what outcomes depend on.
        judging: settings that say what the columns round, cloud and rank count.
        sensing: of the clouds, as plain values.
    """

    object_name: str
    object_digest: str
    hand_digest: str
    episode: dict[str, Any]
    judging: dict[str, Any]
    sensing: dict[str, Any]

    @staticmethod
    def of(obj: GraspObject, trials: Trials, config: JudgeConfig) -> OwnProvenance:
        """Of the trials on an object that a call with these settings makes."""
        choice = {key: getattr(config, key) for key in CHOICE}
        return OwnProvenance(
            obj.name, obj.digest, trials.hand.digest, plain(trials.episode), choice, plain(config.sensing)
        )


@dataclass(frozen=True)
class OwnTrials:
    """The trials on one object that judges chose.

    Attributes:
        position (M, 3), quaternion (M, 4) f32, grasp_type (M,), outcome (M,) int64: as in `trials.table.TrialTable`.
        round (M,) int64: from 1. cloud (M,), rank (M,) int64, probability (M,) f32: as in `rows.Chosen`.
        versions: package -> version that made it.
        grasp_types: names of the hand's grasp types.
        causes: why each ended; None of an episode that does not know.
    """

    provenance: OwnProvenance
    position: Tensor
    quaternion: Tensor
    grasp_type: Tensor
    outcome: Tensor
    round: Tensor
    cloud: Tensor
    rank: Tensor
    probability: Tensor
    versions: dict[str, str]
    grasp_types: tuple[str, ...]
    causes: Causes | None = None

    @staticmethod
    def of(provenance: OwnProvenance, chosen: Chosen, number: int, grasp_types: tuple[str, ...]) -> OwnTrials:
        """What was chosen in round `number`, none of it tried yet."""
        poses = chosen.poses
        position, quaternion = se3.position_of(poses.T).float(), se3.quaternion_of(poses.T.double()).float()
        outcome, round_ = (torch.full((len(poses),), value) for value in (0, number))
        columns = (position, quaternion, poses.grasp_type, outcome, round_)
        said = chosen.cloud, chosen.rank, chosen.probability
        return OwnTrials(provenance, *columns, *said, versions(), grasp_types)

    def ended(self, words: Sequence[str]) -> OwnTrials:
        """The same, now tried; words: how each ended (`label.Label`)."""
        causes = Causes.of([Label.of(word) for word in words]) if has_causes(self.provenance.episode) else None
        return replace(self, outcome=codes(words), causes=causes)

    @staticmethod
    def together(parts: Sequence[OwnTrials]) -> OwnTrials:
        """Rounds of one object, one after the other."""
        columns: Any = {name: torch.cat([getattr(part, name) for part in parts]) for name in _COLUMNS}
        causes = Causes.together([part.causes for part in parts if part.causes]) if parts[0].causes else None
        return replace(parts[0], **columns, causes=causes)

    def at_round(self, number: int) -> OwnTrials:
        """Those of one round."""
        at = self.round == number
        columns: Any = {name: getattr(self, name)[at] for name in _COLUMNS}
        return replace(self, **columns, causes=self.causes and self.causes.at(at))

    @property
    def chosen(self) -> Chosen:
        """As they were tried."""
        poses = Hypotheses(pose_matrix(self.position, self.quaternion), self.grasp_type)
        return Chosen(poses, self.cloud, self.rank, self.probability)


_WHOLE = ("provenance", "versions", "grasp_types", "causes")
_COLUMNS = [part.name for part in fields(OwnTrials) if part.name not in _WHOLE]


def write_own(folder: Path, own: OwnTrials) -> None:
    """Write the table of an object into `folder`, with its seal, atomically."""
    columns = columns_of(own) | (own.causes.columns() if own.causes else {})
    columns |= {name: getattr(own, name).numpy().astype(kind) for name, kind in WHOLE.items()}
    columns["probability"] = own.probability.numpy()
    about = {"schema": SCHEMA, "origin": asdict(own.provenance), "versions": own.versions}
    write_columns(table_path(folder, own.provenance.object_name), columns, {KEY: json.dumps(about, sort_keys=True)})


def read_own(folder: Path, expected: Iterable[OwnProvenance], grasp_types: tuple[str, ...]) -> list[OwnTrials]:
    """The tables of `expected`, in its order; `grasp_types`: the hand's.

    Raises InputError where one is missing, damaged, of other types, or was made from something else than expected.
    """
    found = []
    for provenance in expected:
        own = _read(table_path(folder, provenance.object_name), grasp_types)
        compare(table_path(folder, provenance.object_name), provenance, own.provenance)  # type: ignore[arg-type]
        found.append(own)
    return found


def _read(path: Path, grasp_types: tuple[str, ...]) -> OwnTrials:
    if not path.is_file():
        raise InputError(
            f"{path}: expected {WHAT}, got no such file; make it: python -m spgf_torch.judge leaves own_trials/"
        )
    check_seal(path, WHAT)
    content = parquet_table(path, WHAT, (*COLUMNS, *WHOLE, "probability", *CAUSE_COLUMNS), MOST_ROWS)
    try:
        own = _decoded(path, content, grasp_types)
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, pa.ArrowException) as error:
        raise unreadable(path, f"the columns of {WHAT}", error, "others") from error
    check_poses(path, own.position, own.quaternion)
    _check_counts(path, own)
    return own


def _decoded(path: Path, content: pa.Table, grasp_types: tuple[str, ...]) -> OwnTrials:
    about = json_of((content.schema.metadata or {}).get(KEY, b"{}"), path, WHAT)
    if about.get("schema") != SCHEMA:
        raise InputError(f"{path}: expected {WHAT}, of schema {SCHEMA}, got {about.get('schema', 'another file')}")
    whole = {name: torch.from_numpy(content[name].to_numpy().astype(np.int64)) for name in WHOLE}
    provenance = OwnProvenance(**about["origin"])
    return OwnTrials(
        provenance=provenance,
        position=floats(content, POSITION),
        quaternion=floats(content, QUATERNION),
        grasp_type=codes_in(path, content, "type", grasp_types),
        outcome=codes_in(path, content, "outcome", OUTCOMES),
        probability=floats(content, ("probability",))[:, 0],
        versions=about["versions"],
        grasp_types=grasp_types,
        causes=Causes.read(path, content) if has_causes(provenance.episode) else None,
        **whole,
    )


def _check_counts(path: Path, own: OwnTrials) -> None:
    """InputError for a round, a place or a probability that no choice gives."""
    judging = own.provenance.judging
    clouds = 2 * (judging["one_view"] + judging["four_views"])  # alone and on a table
    for name, low, high in (
        ("round", 1, judging["rounds"] + 1),  # the last is that of validation
        ("cloud", 0, clouds - 1),
        ("rank", PICKED, judging["best"] - 1),
        ("probability", 0, 1),
    ):
        values = getattr(own, name)
        if len(values) and not low <= float(values.min()) <= float(values.max()) <= high:
            got = f"{float(values.min()):g} to {float(values.max()):g}"
            raise InputError(f"{path}: expected {name} from {low} to {high}, got {got}")
