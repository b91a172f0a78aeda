"""One feature step by step (paper, section 3.1), by the operators' own functions: what Figs. 1 to 6 draw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spgf_torch.drawing.style import camera
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import Features
from spgf_torch.ops.alignment import highest_curvature
from spgf_torch.ops.moving_average import averaged, triangle
from spgf_torch.ops.pairwise_relations import Pairs, pairs_of, reference_frames, relations
from spgf_torch.ops.ring_grid import Ring, organised
from spgf_torch.reporting.figures.pieces import View
from spgf_torch.sensing.texlets import Texlets

STEEP = 0.5  # cosine; texlets turned further from the camera than this are hard to see
PAIR_DEG = (30.0, 55.0, 40.0)  # alpha1, alpha2, alpha3 of a pair whose three angles are all well seen
FAR = 0.6  # of the radius; nearer neighbours crowd the drawing


@dataclass(frozen=True)
class Surroundings:
    """The neighbours of every texlet and how they lie.

    Attributes:
        pairs: of each of N texlets its neighbours. neighbour: (P,) which texlet each is.
        frames: (N, 3, 3) columns R_x, R_y, n1. angles: (3, P) alpha1, alpha2, alpha3 in radians.
    """

    texlets: Texlets
    pairs: Pairs[np.ndarray]
    neighbour: np.ndarray
    frames: np.ndarray
    angles: np.ndarray

    @staticmethod
    def of(texlets: Texlets, radius: float) -> Surroundings:
        """Steps 1 and 2, within `radius` m."""
        X, n = texlets.positions.double().numpy(), texlets.normals.double().numpy()
        near = np.linalg.norm(X[:, None] - X, axis=2) <= radius
        np.fill_diagonal(near, False)
        start = np.concatenate([[0], near.sum(axis=1).cumsum()])
        neighbour = near.nonzero()[1].astype(np.int32)
        pairs = pairs_of(start, neighbour, X, X, n)
        frames = reference_frames(n, pairs.towards)
        return Surroundings(texlets, pairs, neighbour, frames, relations(pairs, frames))

    def own(self, i: int) -> slice:
        """The pairs of texlet i."""
        return slice(int(self.pairs.start[i]), int(self.pairs.start[i + 1]))

    def telling_pair(self, radius: float) -> tuple[int, int]:
        """The centre and the pair whose angles come nearest to `PAIR_DEG`."""
        far = np.linalg.norm(self.pairs.step, axis=0) >= FAR * radius
        apart = np.abs(np.degrees(self.angles) - np.array(PAIR_DEG)[:, None]).max(axis=0)
        pair = int(np.nanargmin(np.where(far, apart, np.inf)))
        return int(np.searchsorted(self.pairs.start, pair, side="right")) - 1, pair


@dataclass(frozen=True)
class Steps:
    """Steps 1 to 6 of one feature, all in the frame that its R_x begins, degrees.

    Attributes:
        position: (3,) m. frame: (3, 3) columns R_x, R_y, n1.
        steps: (J, 3) m, from the centre to its neighbours, in that frame; normals: (J, 3) theirs.
        angles: (3, J) alpha1, alpha2, alpha3; top: (J,) bool, on the top layer.
        grid: (2, cells, 2) the cells' means, NaN where empty; smooth: the same after the moving average, gaps encoded.
        gap: (2, cells) bool. start: the cell that becomes cell 0.
        window: how many cells ahead (behind: negative) the average reaches, and the weight there.
    """

    position: np.ndarray
    frame: np.ndarray
    neighbour: np.ndarray
    steps: np.ndarray
    normals: np.ndarray
    angles: np.ndarray
    top: np.ndarray
    grid: np.ndarray
    smooth: np.ndarray
    gap: np.ndarray
    start: int
    window: dict[int, float]

    @property
    def aligned(self) -> np.ndarray:
        """(2, cells, 2) the rings from the start on."""
        return np.roll(self.smooth, -self.start, axis=1)

    @property
    def T_object_feature(self) -> np.ndarray:  # noqa: N802
        """(4, 4) the aligned pose."""
        turn = self.start * 2 * np.pi / self.gap.shape[1]
        cos, sin = np.cos(turn), np.sin(turn)
        T = np.eye(4)
        T[:3, :3] = self.frame @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        T[:3, 3] = self.position
        return T

    @staticmethod
    def of(around: Surroundings, i: int, config: FeatureConfig) -> Steps:
        """Of texlet i, with the paper's alignment and encoding of gaps."""
        own, frame, ring = around.own(i), around.frames[i], Ring(config.cells, config.half_length, config.layers)
        angles = np.ascontiguousarray(around.angles[:, own])
        grid = organised(np.array([0, angles.shape[1]]), angles, ring)
        smooth, _ = averaged(grid, ring.half_length, "saturated", False)
        number, sums = np.split(grid[0].swapaxes(1, 2), [1], axis=2)  # (2, cells, 1), (2, cells, 2)
        window = {int(k): float(w) for k, w in zip(*triangle(config.cells, config.half_length), strict=True) if w > 0}
        reach = np.array([np.roll(number[..., 0] > 0, k, axis=1) for k in window])
        return Steps(
            position=around.texlets.positions[i].double().numpy(),
            frame=frame,
            neighbour=around.neighbour[own],
            steps=around.pairs.step[:, own].T @ frame,
            normals=around.pairs.normal[:, own].T @ frame,
            angles=np.degrees(angles),
            top=angles[1] <= np.pi / 2,
            grid=np.degrees(sums / np.where(number > 0, number, np.nan)),
            smooth=np.degrees(smooth[0]),
            gap=np.asarray(~reach.any(axis=0)),
            start=int(highest_curvature(smooth)[0]),
            window=window,
        )


def telling_feature(found: Features, normals: np.ndarray, view: View) -> int:
    """The feature to show: of those that face the camera one with a gap on top and a wall's other side, else a bend."""
    degrees = np.degrees(found.rings.double().numpy())
    gap = degrees[..., 0] >= 89.99
    ends = ((gap[:, 0].mean(1) >= 0.1) & (gap[:, 1].mean(1) <= 0.5)).astype(float)
    front = normals @ camera(view)[2]
    score = 2 * ends + np.ptp(degrees[:, 0, :, 1], axis=1) / 180 + front
    return int(np.where(front > STEEP, score, score - 10).argmax())
