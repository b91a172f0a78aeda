"""`grasps.json`, the contract of `python -m spgf_torch.predict`, schema 1 (design: results are files with a contract).

Every pose is 4 rows of 4 numbers, `p_input = T_input_x @ p_x`; lengths m, angles rad; `frame` is always "input".
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from spgf_torch.errors import InputError
from spgf_torch.files.checks import content, entries, entry, joint_values, name, number, rigid, whole
from spgf_torch.files.reading import json_of
from spgf_torch.files.writing import write_text
from spgf_torch.hands.records import Grasp, Gripper, gripper_for

SCHEMA = 1
# Keys of what a judge says: the probability that the open hand collides with nothing, and that it then holds.
_FACTORS = ("free", "holds")


def write_grasps(
    path: Path, grasps: Sequence[Grasp], grippers: Mapping[str, Gripper], judge: Mapping[str, Any] | None = None
) -> None:
    """Write grasps, best first, a line each: numbers in full, the file atomically.

    T_input_tcp and T_input_pregrasp are poses of the TCP (+z approach, +x closing), T_input_base is the pose of the
    hand's base link `base_link` with the axes of its URDF; all in the input's frame.

    Args:
        judge: who ranked and what was known, under the key "judge"; None: the votes ranked.
    """
    head: dict[str, Any] = {"schema": SCHEMA, "frame": "input"}
    head |= {"base_link": next(iter(grippers.values())).base_link, **({} if judge is None else {"judge": dict(judge)})}
    lines = [json.dumps(_plain(grasp, gripper_for(grasp, grippers)), allow_nan=False) for grasp in grasps]
    opened = json.dumps({**head, "grasps": []}).removesuffix("]}")
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
    return [_grasp(values, f"{path}: grasps[{i}]") for i, values in enumerate(listed)]


def _plain(grasp: Grasp, gripper: Gripper) -> dict[str, Any]:
    return {
        "type": grasp.type,
        "probability": grasp.probability,
        "support": grasp.support,
        "target": grasp.target,
        "score": grasp.score,
        "gripper": gripper.name,
        "T_input_tcp": grasp.T_input_tcp.tolist(),
        "T_input_base": grasp.T_input_base.tolist(),
        "T_input_pregrasp": grasp.T_input_pregrasp.tolist(),
        "joints": grasp.joints,
        "closed": grasp.closed,
        "voted_by": [{"prototype": prototype, "votes": votes} for prototype, votes in grasp.voted_by],
        **({"judged": dict(zip(_FACTORS, grasp.judged, strict=True))} if grasp.judged else {}),
    }


def _grasp(values: Any, where: str) -> Grasp:
    tcp, base, pregrasp = (
        rigid(entry(values, key, where), f"{where}.{key}")
        for key in ("T_input_tcp", "T_input_base", "T_input_pregrasp")
    )
    opened, closed = (joint_values(entry(values, key, where), f"{where}.{key}") for key in ("joints", "closed"))
    votes = entries(entry(values, "voted_by", where), f"{where}.voted_by")
    return Grasp(
        type=name(entry(values, "type", where), f"{where}.type"),
        probability=number(entry(values, "probability", where), f"{where}.probability", 0.0, 1.0),
        support=whole(entry(values, "support", where), f"{where}.support"),
        T_input_tcp=tcp,
        T_input_base=base,
        joints=opened,
        closed=closed,
        T_input_pregrasp=pregrasp,
        voted_by=[_vote(vote, f"{where}.voted_by[{i}]") for i, vote in enumerate(votes)],
        target=whole(values.get("target", 1), f"{where}.target"),
        score=number(values.get("score", 0.0), f"{where}.score"),
        judged=_judged(values["judged"], f"{where}.judged") if "judged" in values else None,
    )


def _judged(values: Any, where: str) -> tuple[float, float]:
    free, holds = (number(entry(values, key, where), f"{where}.{key}", 0.0, 1.0) for key in _FACTORS)
    return free, holds


def _vote(values: Any, where: str) -> tuple[int, int]:
    prototype, votes = (whole(entry(values, key, where), f"{where}.{key}") for key in ("prototype", "votes"))
    return prototype, votes
