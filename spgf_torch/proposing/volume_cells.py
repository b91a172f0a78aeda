"""The volume of an open hand as the search for hypotheses takes it: its pieces, and the cells that they reach into."""

from __future__ import annotations

import numpy as np
import torch

from spgf_torch.affordance.sensed_collision import HandVolume
from spgf_torch.ops.deepest_free import Volume
from spgf_torch.ops.push_loops import CELL, PIECES, ROOM


def with_cells(volume: HandVolume) -> Volume:
    """A volume for `ops.deepest_free`."""
    bounds = torch.stack([volume.low, volume.high]).double().cpu().numpy()
    shape = np.ceil((bounds[1] - bounds[0] + 2 * ROOM) / CELL).astype(int)
    middles = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1) + 0.5
    middles = (bounds[0] - ROOM + CELL * middles).reshape(-1, 3)
    cells = np.zeros(len(middles), np.int32)
    each = [piece.double().cpu().numpy() for piece in volume.planes]
    for piece, planes in enumerate(each):
        size = np.abs(planes[:, :3]).sum(axis=1) * (CELL / 2 + 2 * ROOM)
        within = np.arange(len(middles))
        for normal, most in zip(planes[:, :3], planes[:, 3] + size, strict=True):  # each leaves the next one fewer
            within = within[middles[within] @ normal <= most]
        cells[within] |= 1 << min(piece, PIECES)
    end = np.cumsum([len(planes) for planes in each])
    arrays = bounds, np.concatenate(each), end, np.pad(cells.reshape(shape), 1)
    return Volume(*map(torch.from_numpy, arrays))
