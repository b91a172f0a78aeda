"""GraspGen's WebDataset: `shard_%03d.tar` with a sample an object and gripper, and `uuid_index.json` {uuid: shard}.

A sample's `__key__` is its uuid OBJECT_TYPE; its one file `grasps.json` is what `graspgen` writes into a file.
`map_uuid_to_path.json` beside the meshes says which one belongs to a uuid; GraspGen looks for it there.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from spgf_torch.errors import InputError
from spgf_torch.files.checks import entry, whole
from spgf_torch.files.reading import json_of, json_values
from spgf_torch.formats import tar
from spgf_torch.formats.common import mesh_file, write_splits
from spgf_torch.formats.graspgen import GraspgenFile, grasps_of_json, grasps_text
from spgf_torch.formats.trial_sets import TrialSet, grasps_of
from spgf_torch.objects.grasp_object import GraspObject

INDEX, MAP, GRASPS = "uuid_index.json", "map_uuid_to_path.json", "grasps.json"
IN_SHARD = 20  # objects and grippers: GraspGen's reader searches a shard from its beginning


def uuid(obj: GraspObject, grasp_type: str) -> str:
    return f"{obj.name}_{grasp_type}"


def shard_name(number: int) -> str:
    return f"shard_{number:03d}.tar"


def write_shards(folder: Path, trials: TrialSet, advance: Callable[[int], None]) -> None:
    """Shards, index and splits into `folder`, the map of meshes beside it."""
    folder.mkdir(parents=True)
    pairs = [(i, grasp_type) for i in range(len(trials.objects)) for grasp_type in trials.grippers]
    shards = {uuid(trials.objects[i], grasp_type): at // IN_SHARD for at, (i, grasp_type) in enumerate(pairs)}
    for first in range(0, len(pairs), IN_SHARD):
        with tar.written(folder / shard_name(first // IN_SHARD)) as shard:
            for i, grasp_type in pairs[first : first + IN_SHARD]:
                obj, gripper = trials.objects[i], trials.grippers[grasp_type]
                text = grasps_text(obj, gripper, grasps_of(trials, i, gripper))
                tar.add(shard, f"{uuid(obj, grasp_type)}.{GRASPS}", text.encode())
        advance(len(pairs[first : first + IN_SHARD]))
    (folder / INDEX).write_text(json.dumps(shards, indent=1) + "\n")
    paths = {uuid(trials.objects[i], grasp_type): mesh_file(trials.objects[i]) for i, grasp_type in pairs}
    (folder.parent / MAP).write_text(json.dumps(paths, indent=1) + "\n")
    for grasp_type, gripper in trials.grippers.items():
        write_splits(folder / "splits" / gripper.name, trials, lambda obj, grasp_type=grasp_type: uuid(obj, grasp_type))  # type: ignore[misc]


def read_shards(folder: Path) -> dict[str, GraspgenFile]:
    """uuid -> grasps of everything that the index names.

    Raises InputError in one line for an index or a shard that is missing, cut off or another, and for a uuid that is
    not in the shard that the index names.
    """
    index = json_values(folder / INDEX, "an index of shards")
    if not isinstance(index, dict):
        raise InputError(f"{folder / INDEX}: expected uuids and shards, got {index!r:.40}")
    found: dict[str, GraspgenFile] = {}
    for number in sorted({whole(at, f"{folder / INDEX}: {key}") for key, at in index.items()}):
        path = folder / shard_name(number)
        for key, files in tar.samples(path):
            where = f"{path}: {key}"
            known = json_of(entry(files, GRASPS, where), Path(where), "grasps in GraspGen's format")
            if index.get(key) == number:
                found[key] = grasps_of_json(known, where)
    if missing := index.keys() - found.keys():
        raise InputError(f"{folder / INDEX}: expected {min(missing)} in shard {index[min(missing)]}, got none")
    return {key: found[key] for key in index}
