"""A baseline without learning: the hypotheses that a judge gets, ranked by how well the pads face the surface.

Score: the mean over both sides of how far inside the friction cone the normals at the pads lie (`judge_features`),
drawn to 0 where few points are seen between the pads. One side alone, as with one view, gives at most half.
"""

from __future__ import annotations

import torch
from torch import Tensor

from spgf_torch.proposing.clearance import Surroundings
from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.proposing.hypotheses import Search
from spgf_torch.proposing.judge_features import NAMES, Seen, in_images, judge_features
from spgf_torch.proposing.judge_proposer import Ranked, best_of

# Points between the pads from which on a score counts in full.
ENOUGH = 12


def antipodal(search: Search, config: ProposingConfig, seen: Seen, around: Surroundings) -> Ranked:
    """The best-scored grasps, no two of which are the same; their scores, in the place of probabilities, are none."""
    hypotheses = search.hypotheses(seen.texlets, around)
    hypotheses = hypotheses.at(in_images(seen, hypotheses, search))
    return best_of(seen, hypotheses, antipodal_score(judge_features(seen, hypotheses, search)), search, config)


def antipodal_score(numbers: Tensor) -> Tensor:
    """(G,) f32 in 0 to 1, of the numbers (G, 31) of hypotheses."""
    worse, better, points = (numbers[:, NAMES.index(name)] for name in ("anti_min", "anti_max", "log_points"))
    return (worse + better) / 2 * (torch.expm1(points) / ENOUGH).clamp(max=1)
