"""Finished scenes on disk: a run that ends at any moment loses only the scenes that it was about.

In a run's folder `scenes/`: of each scene NUMBER.npz (poses, sensed points, cameras, motion) and, written after it,
NUMBER.json (all else), which names what it was made with. Both are written whole or not at all; the JSON carries its
own seal and the other's digest.
"""

from __future__ import annotations

import fcntl
import io
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spgf_torch.clearing.rounds import ClearedScene, Measured
from spgf_torch.drawing.clutter_records import Clip, Round, Tried, View
from spgf_torch.errors import InputError
from spgf_torch.files.digests import digest_of, sealed_json
from spgf_torch.files.reading import json_values
from spgf_torch.files.writing import write_bytes
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.arrangements import scaled

SCENES = "scenes"
_CLIP = ("times", "object_poses", "link_poses")
Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class SceneFiles:
    """The finished scenes of a run.

    Attributes:
        folder: of the run. made_with: fingerprint of all that a scene depends on. objects: name -> object.
    """

    folder: Path
    made_with: str
    objects: Mapping[str, GraspObject]

    @contextmanager
    def open(self) -> Iterator[None]:
        """Keep other calls out. Raises InputError for a folder that cannot be made or that another call writes to."""
        try:
            self._scenes.mkdir(parents=True, exist_ok=True)
            lock = (self._scenes / ".lock").open("a")
        except OSError as error:
            got = f"{self.folder} ({error.strerror})"
            raise InputError(f"out: expected a folder that can be made and written to, got {got}") from None
        with lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_NB | fcntl.LOCK_EX)
            except BlockingIOError:
                raise InputError(f"out: expected a folder that no other clutter writes to, got {self.folder}") from None
            except OSError:
                pass  # no locks on this file system: two calls would do the work twice, with the same results
            yield

    def read(self, number: int) -> ClearedScene | None:
        """A finished scene; None where there is none, or a damaged one, which is then to be cleared again.

        Raises InputError for one of other settings.
        """
        path = self._path(number)
        try:
            content = json_values(path, "a scene of clutter", sealed=True)
            if content["made_with"] != self.made_with:
                raise _OtherError
            if digest_of(path.with_suffix(".npz")) != content["arrays"]:
                return None
            with np.load(path.with_suffix(".npz")) as arrays:
                return _scene(content, dict(arrays), self.objects)
        except _OtherError:
            got = "one made with others"
            raise InputError(f"{path}: expected a scene of these settings and versions, got {got}") from None
        except (InputError, OSError, KeyError, ValueError, TypeError):
            return None

    def write(self, scene: ClearedScene) -> None:
        path, arrays = self._path(scene.number), io.BytesIO()
        content, kept = _content(scene, self.objects)
        np.savez(arrays, **kept)  # type: ignore[arg-type]
        write_bytes(path.with_suffix(".npz"), arrays.getvalue())
        digest = digest_of(path.with_suffix(".npz"))
        write_bytes(path, sealed_json({"made_with": self.made_with, "arrays": digest, **content}, indent=1))

    @property
    def _scenes(self) -> Path:
        return self.folder / SCENES

    def _path(self, number: int) -> Path:
        return self._scenes / f"{number:05d}.json"


class _OtherError(Exception):
    """A scene of other settings."""


def _content(scene: ClearedScene, objects: Mapping[str, GraspObject]) -> tuple[dict[str, Any], Arrays]:
    """What goes into JSON, and the arrays."""
    its, arrays, rows = scene.round, Arrays(), []
    for k, (tried, measured) in enumerate(zip(its.attempts, scene.measured, strict=True)):
        arrays |= _view_arrays(f"{k}", tried.view)
        row: dict[str, Any] = {
            "present": list(tried.view.present),
            "grasp_type": tried.grasp_type,
            "probability": None if math.isnan(tried.probability) else tried.probability,
            "success": tried.success,
            "cause": tried.cause,
            "taken": tried.taken,
            "touched": tried.touched,
            "measured": asdict(measured),
        }
        arrays[f"{k}/T_world_tcp"] = tried.T_world_tcp
        if tried.clip is not None:
            row["filmed"], row["links"] = list(tried.clip.objects), list(tried.clip.links)
            arrays |= {f"{k}/{name}": np.asarray(getattr(tried.clip, name)) for name in _CLIP}
        rows.append(row)
    last = None
    if its.last is not None:
        last = list(its.last.present)
        arrays |= _view_arrays("last", its.last)
    sizes = [
        {"name": obj.name, "scale": float(obj.mesh.extents[2] / objects[obj.name].mesh.extents[2])}
        for obj in its.objects
    ]
    about = {"number": scene.number, "seed": scene.seed, "fold": scene.fold, "method": its.method, "name": its.name}
    return {**about, "objects": sizes, "ended": its.ended, "attempts": rows, "last": last}, arrays


def _scene(content: Mapping[str, Any], arrays: Arrays, objects: Mapping[str, GraspObject]) -> ClearedScene:
    tried = []
    for k, row in enumerate(content["attempts"]):
        clip = None
        if "links" in row:
            times, poses, links = (arrays[f"{k}/{name}"] for name in _CLIP)
            clip = Clip(times, row["filmed"], poses, row["links"], links)
        probability = math.nan if row["probability"] is None else row["probability"]
        its = row["grasp_type"], arrays[f"{k}/T_world_tcp"], probability, row["success"], row["cause"]
        tried.append(Tried(_view(f"{k}", row["present"], arrays), *its, row["taken"], row["touched"], clip))
    last = None if content["last"] is None else _view("last", content["last"], arrays)
    things = [scaled(objects[each["name"]], each["scale"]) for each in content["objects"]]
    measured = tuple(Measured(**row["measured"]) for row in content["attempts"])
    planned = sum(its.planning for its in measured)
    ended = Round(content["method"], content["name"], things, tried, content["ended"], last, planned)
    return ClearedScene(content["number"], content["seed"], content["fold"], ended, measured)


def _view_arrays(prefix: str, view: View) -> Arrays:
    return {f"{prefix}/{name}": getattr(view, name) for name in ("poses", "points", "cameras")}


def _view(prefix: str, present: list[int], arrays: Arrays) -> View:
    return View(tuple(present), *(arrays[f"{prefix}/{name}"] for name in ("poses", "points", "cameras")))
