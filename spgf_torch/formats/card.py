"""The dataset card: what is in the folder, how much of it, from what it was made, under which licence, checksums.

`card.json` for programs, `README.md` for readers. The checksums cover every other file.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.card_header import card_header
from spgf_torch.files.checks import entry
from spgf_torch.files.digests import digest_of, sealed_json
from spgf_torch.files.reading import json_values
from spgf_torch.formats.common import mesh_file
from spgf_torch.formats.config import ExportConfig
from spgf_torch.formats.trial_sets import TrialSet
from spgf_torch.objects.config import CLASSES
from spgf_torch.paths import find, root
from spgf_torch.settings import plain
from spgf_torch.simulation.causes import has_causes
from spgf_torch.simulation.table import OUTCOMES

SCHEMA = 1
OURS, NOT_STATED = "MIT", "not stated"
CARD, README = "card.json", "README.md"
# Settings that say where and how it was made, not what.
PRIVATE = ("out", "overwrite", "workers", "cache", "cache_gb")
# The Hub's classes of size, from so many samples on.
SIZES = ((1_000_000, "1M<n<10M"), (100_000, "100K<n<1M"), (10_000, "10K<n<100K"), (1000, "1K<n<10K"), (0, "n<1K"))

LAYOUT = {
    "acronym": "`acronym/GRIPPER/<Category>_<id>_<scale>.h5`: HDF5 as ACRONYM's; `joints.json` beside them",
    "graspgen": """\
`graspgen/grasp_data/GRIPPER/OBJECT.json`, `graspgen/grippers/GRIPPER.yaml`: as GraspGen's; object root: this folder""",
    "webdataset": """\
`webdataset/shard_NNN.tar`, `uuid_index.json`: GraspGen's WebDataset, uuid = OBJECT_TYPE
- `webdataset/samples/foldF-NNN.tar`: a training sample a trial, in random order within fold F: `cloud.npy`, float32
  (P, 3), sensed points in the frame of the TCP, and `json`""",
    "isaac": "`isaac/GRIPPER/OBJECT.yaml`: Isaac grasp files, version 1.0; confidence 1 held, 0 failed",
    "graspnet": """\
`graspnet/GRIPPER/OBJECT.npy`: graspnetAPI's (N, 17) in the object's frame, x approach, y closing; score 1 held,
  0 failed; `joints.json` beside them""",
}


def card(trials: TrialSet, config: ExportConfig, formats: Sequence[str]) -> dict[str, Any]:
    """What `card.json` holds, but for the checksums."""
    provenance, hand = trials.tables[0].provenance, trials.hand
    settings = {key: value for key, value in plain(config).items() if key not in PRIVATE}
    return {
        "schema": SCHEMA,
        "license": config.license or (OURS if _shipped(config) else NOT_STATED),
        "formats": list(formats),
        "frames": "T of the gripper in the object's mesh: +z approach, +x closing, origin at the hand's base; m, rad",
        "counts": {"objects": len(trials.objects), "trials": trials.trials, "success": _successes(trials)},
        "rates": rates(trials),
        "outcomes": {word: sum(int((t.outcome == i).sum()) for t in trials.tables) for i, word in enumerate(OUTCOMES)},
        "folds": config.folds,
        "grippers": [gripper.name for gripper in trials.grippers.values()],
        "objects": [_object(trials, i) for i in range(len(trials.objects))],
        "trials": {
            **{key: value for key, value in asdict(provenance).items() if not key.startswith("object")},
            "hand": hand.config.name,
            "versions": trials.tables[0].versions,
        },
        "settings": settings,
    }


def write_card(folder: Path, known: dict[str, Any]) -> None:
    """README.md, then card.json with the checksum of every file in the folder."""
    (folder / README).write_text(readme(known))
    (folder / CARD).write_bytes(sealed_json({**known, "files": checksums(folder)}, indent=1))


def check_card(folder: Path) -> dict[str, Any]:
    """The card of a folder whose files are all as its checksums say.

    Raises InputError in one line for the first file that is missing, changed, or not on the card.
    """
    known = read_card(folder)
    listed, found = listed_in(folder), checksums(folder)
    for file in sorted({*listed, *found}):
        if listed.get(file) != found.get(file):
            got = "no such file" if file not in found else "another" if file in listed else "a file not on the card"
            raise InputError(f"{folder / file}: expected the file of {CARD}, got {got}")
    return known


def read_card(folder: Path) -> dict[str, Any]:
    """The card of a folder, held to its own digest. Raises InputError for another file, or one of another schema."""
    path = folder / CARD
    known = json_values(path, "a dataset card", sealed=True)
    if (got := entry(known, "schema", str(path))) != SCHEMA or isinstance(got, bool):
        raise InputError(f"{path}: expected schema {SCHEMA}, got {got!r:.40}")
    return dict(known)


def listed_in(folder: Path) -> dict[str, Any]:
    """File -> its bytes and SHA-256, as the card of the folder lists them. Raises InputError where there is none."""
    listed = entry(read_card(folder), "files", str(folder / CARD))
    if not isinstance(listed, dict):
        raise InputError(f"{folder / CARD}: files: expected names and checksums, got {listed!r:.40}")
    return listed


def check_files(folder: Path, paths: Iterable[Path]) -> None:
    """Raises InputError in one line for the first of some files of a data set that is not as its card says."""
    listed = listed_in(folder)
    for path in paths:
        if listed.get(path.relative_to(folder).as_posix()) != _checksum(path):
            raise InputError(f"{path}: expected the file that {CARD} lists, got a damaged or another one")


def checksums(folder: Path) -> dict[str, dict[str, Any]]:
    """File -> its bytes and SHA-256, for every file but the card. Raises InputError for what is no file of its own."""
    found = files_of(folder)
    if odd := [name for name, path in found.items() if not stat.S_ISREG(path.lstat().st_mode)]:
        raise InputError(f"{folder / odd[0]}: expected a plain file of a data set, got a link or a special file")
    return {name: _checksum(path) for name, path in found.items() if name != CARD}


def files_of(folder: Path) -> dict[str, Path]:
    """Everything in a folder but folders, by its path in it; links are not followed."""
    found = {}
    for parent, folders, names in os.walk(folder):
        for path in (Path(parent, name) for name in [*names, *folders]):
            if path.is_symlink() or not path.is_dir():
                found[path.relative_to(folder).as_posix()] = path
    return dict(sorted(found.items()))


def rates(trials: TrialSet) -> dict[str, dict[str, dict[str, float]]]:
    """class -> type -> trials, successes, rate; `all` beside the classes that occur."""
    names = [name for name in CLASSES if any(obj.category == name for obj in trials.objects)]
    blocks = {}
    for name in (*names, "all"):
        tables = [t for obj, t in zip(trials.objects, trials.tables, strict=True) if name in ("all", obj.category)]
        blocks[name] = {each: _rate(tables, code) for code, each in enumerate(trials.grasp_types)}
    return blocks


def readme(known: dict[str, Any]) -> str:
    """The text of README.md."""
    counts, made = known["counts"], known["trials"]
    rows = [
        f"| {name} | " + " | ".join(_cell(block[grasp_type]) for grasp_type in block) + " |"
        for name, block in known["rates"].items()
    ]
    grasp_types = list(known["rates"]["all"])
    outcomes = ", ".join(f"{word} {count:,}" for word, count in known["outcomes"].items())
    return f"""\
{_header(known)}
# Grasp trials of the hand {made["hand"]}

{counts["trials"]:,} simulated grasps on {counts["objects"]} objects, {counts["success"]:,} of which held; failures are
included. Licence: {known["license"]}. Written by `python -m spgf_torch.export`; `card.json` has the settings, a line an
object and a SHA-256 of every file.

| class | {" | ".join(f"{grasp_type}: held / tried" for grasp_type in grasp_types)} |
|{"---|" * (1 + len(grasp_types))}
{chr(10).join(rows)}

Outcomes: {outcomes}. Success means that SAPIEN {made["versions"].get("sapien", "")} held the object while it was lifted
and shaken: friction {made["episode"]["friction"]:g}, rigid bodies, {_beside(made["episode"])}, no arm.

## Files

{chr(10).join(f"- {LAYOUT[name]}" for name in known["formats"])}
- `meshes/<class>/<id>.obj`: the objects in metres, in the frame of the grasps, as the trials used them
- `clouds/OBJECT.npy`: (N, 6) float32, what simulated depth cameras see: positions (m) and unit normals, the same frame
- `hand/GRIPPER.urdf`: the hand with a root link GRIPPER, of which the grasps are poses; `hand/GRIPPER.json`: its
  joints, open and closed, and the poses of its base link and TCP in that frame

Grippers are {" and ".join(known["grippers"])}: the same hand, open for each of its grasp types. Grasps are poses of the
gripper in the frame of the object's mesh: +z approach, +x closing, origin at the hand's base. Metres, radians. Splits
are the {known["folds"]} folds of the cross-validation over objects: `splits/.../foldF/valid.txt` names the objects of
fold F, `train.txt` the others. An `<id>` is the object's name with - for _.
"""


def _header(known: dict[str, Any]) -> str:
    """What the Hub reads: licence, hand, and how many trials there are, in its powers of ten."""
    licence = None if known["license"] == NOT_STATED else known["license"]
    hand, trials = known["trials"]["hand"], known["counts"]["trials"]
    return card_header(
        hand,
        licence=licence,
        pretty_name=f"Grasp trials of the hand {hand}",
        task_categories=["robotics"],
        size_categories=[next(name for least, name in SIZES if trials >= least)],
    )


def _shipped(config: ExportConfig) -> bool:
    """Whether the objects and the trials are this repository's."""
    given = (("objects", config.objects), ("trials", config.trials))
    return all(find(path).resolve() == (root() / "data" / name).resolve() for name, path in given)


def _object(trials: TrialSet, i: int) -> dict[str, Any]:
    obj, table = trials.objects[i], trials.tables[i]
    return {
        "id": i,
        "name": obj.name,
        "class": obj.category,
        "fold": int(trials.fold[i]),
        "mesh": mesh_file(obj),
        "mass": obj.mass,
        "digest": obj.digest,
        "trials": {each: _rate([table], code) for code, each in enumerate(trials.grasp_types)},
    }


def _rate(tables: Iterable[Any], code: int) -> dict[str, float]:
    success = np.concatenate([table.success.numpy()[table.grasp_type.numpy() == code] for table in tables])
    return {
        "trials": len(success),
        "success": int(success.sum()),
        "rate": round(float(success.mean()), 6) if len(success) else 0.0,
    }


def _beside(episode: Mapping[str, Any]) -> str:
    """What else there was, of an episode's plain values."""
    if not has_causes(episode):
        return "no table"
    return "from a table or out of the air, turned, with mass, friction and pose drawn for each trial"


def _cell(block: dict[str, float]) -> str:
    return f"{block['success']:,} / {block['trials']:,} ({100 * block['rate']:.1f} %)"


def _successes(trials: TrialSet) -> int:
    return sum(int(table.success.sum()) for table in trials.tables)


def _checksum(path: Path) -> dict[str, Any]:
    return {"bytes": path.stat().st_size, "sha256": digest_of(path)}
