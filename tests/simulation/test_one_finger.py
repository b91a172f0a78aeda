"""A grasp needs both fingers: what one alone presses on is not held."""

import numpy as np
import trimesh
from trial_objects import from_above, solid

from spgf_torch.hands.hand import Hand
from spgf_torch.settings import settings
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.episode import Simulator, Trial


def test_what_one_finger_presses_on_is_missed(jaw: Hand) -> None:
    """A plate of half a ton stands 20 mm beside the middle: one finger reaches it, the other stops before."""
    shift = trimesh.transformations.translation_matrix((0.025, 0.0, 0.05))
    plate = solid("plate", trimesh.creation.box((0.01, 0.06, 0.1), shift), mass=500.0)
    trial = Trial(Simulator(plate, jaw, settings(EpisodeConfig)), from_above(0.08).astype(np.float64), "WPG")
    assert trial.run() == "missed"
    assert len(trial._touching()) == 1  # as when it was asked whether the fingers hold
