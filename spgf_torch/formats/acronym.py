"""ACRONYM's HDF5 files (Eppner, Mousavian, Fox 2021): an object and one gripper a file, `<Category>_<id>_<scale>.h5`.

Loaders hard-code the group `flex`, so that the labels stand there although SAPIEN made them, and again in `sapien`.
How far the object moved is not in our trial tables: those columns are NaN and say so in their attribute `provenance`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.extras import needed
from spgf_torch.files.checks import rigid
from spgf_torch.files.reading import unreadable
from spgf_torch.formats.common import JOINTS, mesh_file, object_id, write_joints, write_splits
from spgf_torch.formats.trial_sets import Grasps, TrialSet, grasps_of
from spgf_torch.hands.records import Gripper
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.table import OUTCOMES, TrialTable

if TYPE_CHECKING:
    import h5py

SCALE = 1.0  # the exported meshes are in metres
LARGEST = 1_000_000_000  # bytes of one data set: eight million poses
SMALL, RATIO = 1_000_000, 1100  # bytes; deflate packs no tighter
LABEL = "object_in_gripper"
MOTIONS = tuple(
    f"object_motion_during_{what}_{motion}" for what in ("closing", "shaking") for motion in ("linear", "angular")
)
SCALARS = ("scale", "mass", "density", "friction", "volume")
UNKNOWN = "unknown, hence NaN: the trial table holds how a trial ended, not how far the object moved"


@dataclass(frozen=True)
class AcronymFile:
    """What a file holds.

    Attributes:
        file: of the mesh, relative to the data set. scale: to metres. mass: kg. density: kg/m3. volume: m3.
        com: (3,) m. inertia: (3, 3) kg m2. gripper: its name. configuration: (D,) rad or m.
        transforms: (N, 4, 4) float64, of the gripper in the scaled mesh's frame.
        object_in_gripper: (N,) int64, 0 or 1. motions: name -> (N,), m or rad, NaN where unknown.
    """

    file: str
    scale: float
    mass: float
    density: float
    friction: float
    volume: float
    com: np.ndarray
    inertia: np.ndarray
    gripper: str
    configuration: np.ndarray
    transforms: np.ndarray
    object_in_gripper: np.ndarray
    motions: dict[str, np.ndarray]


def file_name(obj: GraspObject) -> str:
    return f"{obj.category}_{object_id(obj)}_{SCALE}.h5"


def write_acronym(folder: Path, trials: TrialSet, advance: Callable[[int], None]) -> None:
    """`<gripper>/*.h5` with the joints beside them, and `splits`."""
    for gripper in trials.grippers.values():
        (folder / gripper.name).mkdir(parents=True)
        write_joints(folder / gripper.name / JOINTS, gripper)
    for number, (obj, table) in enumerate(zip(trials.objects, trials.tables, strict=True)):
        for gripper in trials.grippers.values():
            grasps = grasps_of(trials, number, gripper)
            write_file(folder / gripper.name / file_name(obj), obj, table, gripper, grasps)
        advance(1)
    write_splits(folder / "splits", trials, file_name)


def write_file(path: Path, obj: GraspObject, table: TrialTable, gripper: Gripper, grasps: Grasps) -> None:
    """One object's trials with one gripper."""
    volume = float(abs(obj.mesh.volume))
    friction = float(table.provenance.episode["friction"])
    scalars = (SCALE, obj.mass, obj.mass / volume, friction, volume)
    with _opened(path, "w") as file:
        group = file.create_group("object")
        group["file"] = np.bytes_(mesh_file(obj))
        for name, value in zip(SCALARS, scalars, strict=True):
            group[name] = np.float64(value)
        group["com"], group["inertia"] = (np.asarray(value, dtype=np.float64) for value in (obj.com, obj.inertia))
        hand = file.create_group("gripper")
        hand["type"] = np.bytes_(gripper.name)
        hand["configuration"] = np.array(list(gripper.joints.values()), dtype=np.float64)
        hand["configuration"].attrs["joint_names"] = list(gripper.joints)
        _column(file, "grasps/transforms", grasps.T_object_gripper)
        made = f"SAPIEN {table.versions.get('sapien', '')} by spgf-torch"
        for engine, provenance in (("flex", f"{made}, not FleX: loaders look for labels here"), ("sapien", made)):
            qualities = file.create_group(f"grasps/qualities/{engine}")
            qualities.attrs["provenance"] = provenance
            _column(qualities, LABEL, grasps.success.astype(np.int64))
            for name in MOTIONS:
                _column(qualities, name, np.full(len(grasps.success), np.nan)).attrs["provenance"] = UNKNOWN
        _column(file["grasps/qualities/sapien"], "outcome", grasps.outcome).attrs["names"] = list(OUTCOMES)


def read_acronym(path: Path) -> AcronymFile:
    """A file in ACRONYM's format, whoever wrote it.

    Raises InputError in one line for a file that is missing, cut off, or lacks what loaders read; for poses that are
    not rigid and labels other than 0 and 1.
    """
    what = "an ACRONYM file"
    if not path.is_file():
        raise InputError(f"{path}: expected {what}, got {'a folder' if path.is_dir() else 'no such file'}")
    try:
        with _opened(path, "r") as file:
            known = _values(file)
    except InputError:
        raise
    except (OSError, RuntimeError, ValueError, AttributeError, TypeError, MemoryError) as error:
        raise unreadable(path, what, error) from None
    count = len(known.transforms)
    columns = [known.object_in_gripper, *known.motions.values()]
    if known.transforms.shape != (count, 4, 4) or any(column.shape != (count,) for column in columns):
        raise InputError(f"{path}: expected N poses with N labels, got {known.transforms.shape} and {columns[0].shape}")
    if not np.isin(known.object_in_gripper, (0, 1)).all():
        raise InputError(f"{path}: {LABEL}: expected 0 and 1, got {known.object_in_gripper.max()} among them")
    for i, T in enumerate(known.transforms):
        rigid(T.tolist(), f"{path}: grasps/transforms[{i}]")
    return known


def _opened(path: Path, mode: str) -> h5py.File:
    needed(f"{path}:", "h5py")
    import h5py

    return h5py.File(path, mode)


def _values(file: h5py.File) -> AcronymFile:
    flex = "grasps/qualities/flex"
    scalars = {name: float(_read(file, f"object/{name}")) for name in SCALARS}
    return AcronymFile(
        **scalars,
        file=_read(file, "object/file").decode(),
        com=_read(file, "object/com"),
        inertia=_read(file, "object/inertia"),
        gripper=_read(file, "gripper/type").decode(),
        configuration=_read(file, "gripper/configuration"),
        transforms=_read(file, "grasps/transforms"),
        object_in_gripper=_read(file, f"{flex}/{LABEL}"),
        motions={name: _read(file, f"{flex}/{name}") for name in MOTIONS},
    )


def _read(file: h5py.File, name: str) -> Any:
    """A data set of this file itself; what claims to be larger than `LARGEST` is not unpacked."""
    try:
        known = file[name]
    except KeyError:
        raise ValueError(f"nothing under {name}") from None
    if known.file.filename != file.filename or known.external or known.is_virtual:
        raise ValueError(f"{name} stands in another file")
    if known.nbytes > LARGEST or known.nbytes > SMALL + RATIO * known.id.get_storage_size():
        raise ValueError(f"{name} has {known.nbytes} bytes, more than {LARGEST} or {RATIO} times what it takes")
    if known.dtype.kind not in "biufS":
        raise ValueError(f"{name} holds {str(known.dtype)[:40]}, not numbers or text of a fixed length")
    return known[()]


def _column(group: Any, name: str, values: np.ndarray) -> Any:
    return group.create_dataset(name, data=values, compression="gzip")
