"""A program of somebody who uses the package and checks types as strictly as mypy does; `make check` reads it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import spgf_torch
from spgf_torch import Grasp, Grasps, InputError, Predictor, Scene


def reachable(grasp: Grasp) -> bool:
    return bool(grasp.pregrasp[2, 3] > 0.05) and grasp.width < 0.1


def planned(points: np.ndarray[Any, np.dtype[np.float64]], T_robot_camera: np.ndarray[Any, Any]) -> Grasps:
    model: Predictor = spgf_torch.load("panda").ready()
    scene: Scene = Scene.from_points(points, viewpoints=(0.0, 0.0, 0.0), sensing=model.sensing, table="find")
    try:
        grasps: Grasps = model.predict(scene, top=5, keep=reachable).transform(T_robot_camera)
    except InputError as error:
        raise SystemExit(str(error)) from error
    return grasps.of_type("WPG").above(0.5)[:3]


def told(grasps: Grasps) -> list[str]:
    best: Grasp | None = grasps.best
    if best is None:
        return []
    again: Grasp = Grasp.from_dict(best.to_dict())
    words = [f"{grasp.type} {grasp.probability:.2f} {grasp.score:.2f} {grasp.joints}" for grasp in grasps]
    page: Path = grasps.show()
    files: list[Path] = grasps.save("out", formats=("json", "moveit"))
    values: dict[str, Any] = grasps.to_dict()
    return [*words, again.transform(np.eye(4)).type, page.name, *(path.name for path in files), *values]
