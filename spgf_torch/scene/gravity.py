"""What is up, as far as the settings, a table, the cameras or the frame tell; hands rather do not come from below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.scene.cloud import vectors
from spgf_torch.scene.config import SceneConfig

AUTO = "auto"
# deg that an approach may rise and still not come from below: a level one, with the noise of normals.
_LEVEL_DEG = 10.0
# A camera that looks down by 15 to 75 deg has "up" within 30 deg of half-way between its picture's up and backwards.
_CAMERA_DEG = 30.0
_CAMERA_UP = np.array([0.0, -1.0, -1.0]) / np.sqrt(2)
# m; a viewpoint as near to the origin is that of a camera's own frame.
_ORIGIN = 1e-3
# Length of the mean of unit vectors, above which they agree. deg between z and what cameras take for up: more is odd.
_ALIKE, _APART_DEG = 0.5, 75.0


@dataclass(frozen=True)
class Gravity:
    """What is up.

    Attributes:
        up: (3,) unit, against gravity. within_deg: how far off it may be.
        words: whence it is known. doubt: what speaks against it; "" nothing. given: by the user.
    """

    up: np.ndarray
    within_deg: float
    words: str
    doubt: str = ""
    given: bool = False

    @property
    def steepest(self) -> float:
        """Component along `up` of a unit approach from which on a hand comes from below."""
        return float(np.sin(np.deg2rad(max(_LEVEL_DEG, self.within_deg))))


_UPRIGHT = "the camera is taken to look down by 45 deg, its picture upright"


def gravity_of(
    config: SceneConfig, viewpoints: np.ndarray | None, rotations: Sequence[np.ndarray] = (), ahead: float = 0.0
) -> Gravity | None:
    """What is up in the input's frame; None where `gravity` is null.

    Args:
        viewpoints: (V, 3) m, of clouds; None: not known.
        rotations: (3, 3) R_input_camera of depth images.
        ahead: 1 where a cloud lies before a camera at the origin along z, -1 along -z as OpenGL's; 0 elsewhere.
    """
    if config.gravity is None:
        return None
    if not isinstance(config.gravity, str):
        down = vectors("gravity", config.gravity, (3,))
        if not np.linalg.norm(down) > 0:
            raise InputError(f"gravity: expected a direction other than 0, got {config.gravity!r}")
        return Gravity(-down / np.linalg.norm(down), 0.0, "by gravity as given", given=True)
    if config.gravity != AUTO:
        raise InputError(f"gravity: expected auto, null or [x,y,z], got {config.gravity}")
    if len(rotations):
        return _of_cameras(rotations)
    if viewpoints is not None and (np.linalg.norm(viewpoints, axis=1) < _ORIGIN).all() and ahead:
        return Gravity(_CAMERA_UP * np.sign(ahead), _CAMERA_DEG, _UPRIGHT)
    return Gravity(np.array([0.0, 0.0, 1.0]), 0.0, "z is taken for up")


def _of_cameras(rotations: Sequence[np.ndarray]) -> Gravity:
    """Of depth images: z in the frame of poses; in a camera's own, half-way between its picture's up and backwards."""
    mean = np.mean([rotation @ _CAMERA_UP for rotation in rotations], axis=0)
    length = float(np.linalg.norm(mean))
    if all(np.allclose(rotation, np.eye(3)) for rotation in rotations):
        return Gravity(mean / length, _CAMERA_DEG, _UPRIGHT)
    apart = float(np.rad2deg(np.arccos(np.clip(mean[2] / max(length, 1e-9), -1, 1))))
    doubt = (
        f"poses: z and the pictures' up are {apart:.0f} deg apart: is z up, and are they T_input_camera with the "
        "camera's z ahead and y down (not OpenGL's, not inverted)? a rolled camera is fine; else gravity=[x,y,z]"
    )
    likely = length > _ALIKE and apart > _APART_DEG  # cameras all around have no common up
    return Gravity(np.array([0.0, 0.0, 1.0]), 0.0, "z is taken for up", doubt if likely else "")
