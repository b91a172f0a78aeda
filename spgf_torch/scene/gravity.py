"""What is up, as far as the settings, a table, the cameras or the frame tell; hands rather do not come from below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spgf_torch.config import InputError, SceneConfig
from spgf_torch.scene.cloud import vectors

AUTO = "auto"
# deg that an approach may rise and still not come from below: a level one, with the noise of normals.
_LEVEL_DEG = 10.0
# A camera that looks down by 15 to 75 deg has "up" within 30 deg of half-way between its picture's up and backwards.
_CAMERA_DEG = 30.0
_CAMERA_UP = np.array([0.0, -1.0, -1.0]) / np.sqrt(2)
# m; a viewpoint as near to the origin is that of a camera's own frame.
_ORIGIN = 1e-3
# Cosine: z of the frame is taken for up where the cameras' own idea of up is this near.
_ALIKE = 0.5


@dataclass(frozen=True)
class Gravity:
    """Attributes: up (3,) unit, against gravity; within_deg: how far off it may be; words: whence it is known."""

    up: np.ndarray
    within_deg: float
    words: str

    @property
    def steepest(self) -> float:
        """Component along `up` of a unit approach from which on a hand comes from below."""
        return float(np.sin(np.deg2rad(max(_LEVEL_DEG, self.within_deg))))


def gravity_of(
    config: SceneConfig, viewpoints: np.ndarray | None, turns: Sequence[np.ndarray] = (), ahead: float = 1.0
) -> Gravity | None:
    """What is up in the input's frame; None where `gravity` is null.

    Args:
        viewpoints: (V, 3) m, of clouds; None: not known.
        turns: (3, 3) R_input_camera of depth images.
        ahead: mean z of a cloud: below 0 its camera looks along -z, as OpenGL's.
    """
    if config.gravity is None:
        return None
    if not isinstance(config.gravity, str):
        down = vectors("gravity", config.gravity, (3,))
        if not np.linalg.norm(down) > 0:
            raise InputError(f"gravity: expected a direction other than 0, got {config.gravity!r}")
        return Gravity(-down / np.linalg.norm(down), 0.0, "gravity is given")
    if config.gravity != AUTO:
        raise InputError(f"gravity: expected auto, null or [x,y,z], got {config.gravity}")
    upright = Gravity(np.array([0.0, 0.0, 1.0]), 0.0, "z is taken for up")
    if len(turns):
        mean = np.mean([turn @ _CAMERA_UP for turn in turns], axis=0)
        own = all(np.allclose(turn, np.eye(3)) for turn in turns)
        if np.linalg.norm(mean) < _ALIKE or (not own and mean[2] > _ALIKE * np.linalg.norm(mean)):
            return upright
        return Gravity(mean / np.linalg.norm(mean), _CAMERA_DEG, "the camera's picture is taken to be upright")
    if viewpoints is not None and (np.linalg.norm(viewpoints, axis=1) < _ORIGIN).all():
        return Gravity(
            _CAMERA_UP * (1 if ahead >= 0 else -1), _CAMERA_DEG, "the camera's picture is taken to be upright"
        )
    return upright
