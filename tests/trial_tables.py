"""Trial tables for tests: poses, types and outcomes of one's own, made from nothing that counts."""

import torch

from spgf_torch.geometry import se3
from spgf_torch.simulation.table import Provenance, TrialTable

ORIGIN = Provenance("thing", "object", "hand", {}, {}, 1, 0)


def trial_table(T: torch.Tensor, grasp_type: torch.Tensor, outcome: torch.Tensor) -> TrialTable:
    """Trials at poses (G, 4, 4) of types (G,), which ended so (G,) int64: index into `table.OUTCOMES`."""
    return TrialTable(ORIGIN, se3.position_of(T), se3.quaternion_of(T), grasp_type, outcome, {}, ("NPG", "WPG"))
