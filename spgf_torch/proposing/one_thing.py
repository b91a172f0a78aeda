"""Whether what lies between the fingers is one thing: two rims side by side look like one wall, and do not hold.

They are two where a good part of what is seen between the fingers is of another body than the rest, or where two
surfaces face each other across a gap. A wider gap is the inside of a container, which is gripped from outside.
"""

from __future__ import annotations

import torch
from torch import Tensor

from spgf_torch.ops.facing_gap import facing_gap
from spgf_torch.proposing.config import NeighboursConfig
from spgf_torch.proposing.hypotheses import Hypotheses, Search, local, parts
from spgf_torch.proposing.judge_features import Seen


def one_thing(seen: Seen, hypotheses: Hypotheses, search: Search, config: NeighboursConfig) -> Tensor:
    """(H,) bool: the fingers would close on one thing, as far as is seen."""
    positions, normals = seen.texlets.positions.float().cpu(), seen.texlets.normals.float().cpu()
    one = torch.ones(len(hypotheses), dtype=torch.bool)
    bodies = torch.zeros(len(positions), dtype=torch.int64) if seen.bodies is None else seen.bodies
    for code, hand in enumerate(search.hands):
        for part in parts((hypotheses.grasp_type == code).nonzero()[:, 0], len(positions)):
            T = hypotheses.T[part]
            at = local(T, positions)
            between = hand.region.holds(*at.unbind(1))
            strange = between & (bodies != seen.body_at(T[:, :3, 3])[:, None])
            share = strange.sum(1) / between.sum(1).clamp(min=1)
            gap = facing_gap(at[:, 0], (T[:, :3, 0] @ normals.T).view(len(T), len(normals)), between)
            one[part] = (share <= config.strangers) & ~((gap > config.gap_from) & (gap < config.gap_to))
    return one
