"""`grasps.json`, the contract of `python -m spgf_torch.predict`, schema 1 (design: results are files with a contract).

Every pose is 4 rows of 4 numbers, `p_input = T_input_x @ p_x`; lengths m, angles rad; `frame` is always "input".
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from spgf_torch.errors import InputError
from spgf_torch.files.checks import content, entries, entry
from spgf_torch.files.reading import json_of
from spgf_torch.files.writing import write_text
from spgf_torch.hands.records import Grasp, Gripper, gripper_for

SCHEMA = 1


def grasps_dict(
    grasps: Sequence[Grasp],
    grippers: Mapping[str, Gripper],
    judge: Mapping[str, Any] | None = None,
    model: Mapping[str, Any] | None = None,
    notes: Sequence[str] | None = None,
) -> dict[str, Any]:
    """What `grasps.json` holds, as plain values.

    T_input_tcp and T_input_pregrasp are poses of the TCP (+z approach, +x closing), T_input_base is the pose of the
    hand's base link `base_link` with the axes of its URDF; all in the input's frame.

    Args:
        grasps: best first.
        judge: who ranked and what was known, under the key "judge"; None: the votes ranked.
        model: whose grasps they are, under the key "model"; None: nothing is said.
        notes: what was assumed of the scene, left out or looks wrong, under the key "notes"; None: it is not known.

    Raises:
        InputError: a grasp of a type that is none of the grippers'.
    """
    for grasp in grasps:
        gripper_for(grasp, grippers)
    head: dict[str, Any] = {"schema": SCHEMA, "frame": "input"}
    head |= {"base_link": next(iter(grippers.values())).base_link}
    head |= {key: dict(said) for key, said in (("model", model), ("judge", judge)) if said is not None}
    head |= {} if notes is None else {"notes": list(notes)}
    return {**head, "grasps": [grasp.to_dict() for grasp in grasps]}


def write_grasps(
    path: Path,
    grasps: Sequence[Grasp],
    grippers: Mapping[str, Gripper],
    judge: Mapping[str, Any] | None = None,
    model: Mapping[str, Any] | None = None,
    notes: Sequence[str] | None = None,
) -> None:
    """Write `grasps_dict`, a grasp a line: numbers in full, the file atomically."""
    values = grasps_dict(grasps, grippers, judge, model, notes)
    lines = [json.dumps(grasp, allow_nan=False) for grasp in values["grasps"]]
    opened = json.dumps({**values, "grasps": []}).removesuffix("]}")
    write_text(path, opened + "".join(f"\n{line}," for line in lines).removesuffix(",") + "\n]}\n")


def read_grasps(path: Path) -> list[Grasp]:
    """The grasps of a `grasps.json`, in its order. Keys that the contract does not know are passed over.

    Raises InputError in one line for a file that is missing, cut off, of another schema or frame, or with a pose that
    is not rigid, a number that is not finite, a type that is no name.
    """
    what = f"grasps of schema {SCHEMA}"
    known = json_of(content(path, what), path, what)
    for key, wanted in (("schema", SCHEMA), ("frame", "input")):
        if (got := entry(known, key, str(path))) != wanted:
            raise InputError(f"{path}: expected {key} {wanted}, got {got!r:.40}")
    listed = entries(entry(known, "grasps", str(path)), f"{path}: grasps")
    return [Grasp.from_dict(values, f"{path}: grasps[{i}]") for i, values in enumerate(listed)]
