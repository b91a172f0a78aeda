"""Grasp hypotheses from sensed geometry alone: the open hand pushed onto a surface as deep as it stays free.

1. Seeds spread over the surface; a frame of each from the normals around it: the mean normal, and the tangent along
   which the surface bends least.
2. Hands that close along either tangent, their approach against the normal and turned about the closing axis; and hands
   that close along the normal, as on a rim, their approach along either tangent.
3. Each in three lateral places: what is seen between the pads in the middle, or its face close to either pad, since
   with one view the far side of a thing may lie further than what is seen of it. Hands without a pad on either side of
   the TCP, such as three fingers in a circle, in the middle alone.
4. Of each the deepest place where the hand is free, and one a little further back.

After GPG (ten Pas and Platt 2017), with the hand's own geometry. Everything looks at relative poses alone, so
hypotheses move with their input.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from spgf_torch.geometry import se3
from spgf_torch.ops.deepest_free import deepest_free
from spgf_torch.ops.extents import extents
from spgf_torch.proposing.clearance import Clearance, Surroundings
from spgf_torch.proposing.closing_region import ClosingRegion
from spgf_torch.proposing.config import HypothesesConfig
from spgf_torch.proposing.hand_geometry import HandGeometry, hand_geometry
from spgf_torch.proposing.sampling import farthest_point_sampling
from spgf_torch.proposing.volume_cells import with_cells
from spgf_torch.sensing.texlets import Texlets

# Angles between -tilt and tilt at which an approach is tried, of hands that close along a tangent and along the normal.
_TANGENT_TILTS, _NORMAL_TILTS = 5, 3
# Of the tilt of the former, that of the latter.
_RIM = 0.75
# Pairs of a frame and a point looked at together: bounds the memory.
_PAIRS = 1 << 19
# How far beyond the pads something seen still counts as what they would close on, in half openings.
_BEYOND = 1.5
# m; side of the cells of obstacles that discard most colliding hypotheses cheaply.
_SPARSE = 0.008


@dataclass(frozen=True)
class Hypotheses:
    """Poses of the open hand, free of all that is known: T (H, 4, 4) f32, grasp_type (H,) int64."""

    T: Tensor
    grasp_type: Tensor

    def __len__(self) -> int:
        return len(self.grasp_type)

    def at(self, chosen: Tensor) -> Hypotheses:
        """Those at the indices (C,) int64 or of the mask (H,) bool."""
        return Hypotheses(self.T[chosen], self.grasp_type[chosen])


@dataclass(frozen=True)
class Search:
    """The search for hypotheses with one hand.

    Attributes:
        hands: the geometry of each grasp type. clearance: what the hand may not touch.
    """

    clearance: Clearance
    config: HypothesesConfig
    hands: tuple[HandGeometry, ...]

    @staticmethod
    def of(clearance: Clearance, config: HypothesesConfig) -> Search:
        return Search(clearance, config, hand_geometry(clearance.volumes, config))

    @cached_property
    def volumes(self) -> tuple[list[Tensor], ...]:
        """Of each grasp type, what may not touch texlets, what obstacles, and what hidden places (`Volume`)."""
        kinds = self.clearance.swept, self.clearance.swollen, self.clearance.seen
        return tuple(
            [part for volumes in kinds for part in with_cells(volumes[name])] for name in self.clearance.grasp_types
        )

    def hypotheses(self, texlets: Texlets, around: Surroundings) -> Hypotheses:
        """Free poses about the texlets, at most `config.hypotheses`; from below, or where grasps
        failed, only where there are no others."""
        positions, normals = texlets.positions.float().cpu(), texlets.normals.float().cpu()
        if not len(positions):
            return Hypotheses(torch.zeros(0, 4, 4), torch.zeros(0, dtype=torch.int64))
        around = around.near(positions, self.clearance.reach)
        T = frames(positions, normals, self.config)
        found = self._found(T, positions, around)
        if not len(found) and around.up is not None:
            found = self._found(T, positions, replace(around, up=None))
        if bool((elsewhere := ~around.failed_at(found.T[:, :3, 3])).any()):
            found = found.at(elsewhere)
        if len(found) > self.config.hypotheses:
            picked = torch.randperm(len(found), generator=torch.Generator().manual_seed(0))
            found = found.at(picked[: self.config.hypotheses].sort().values)
        return found

    def free(self, T: Tensor, grasp_type: Tensor, positions: Tensor, around: Surroundings) -> Tensor:
        """(G,) bool: the open hand touches no point (N, 3) and nothing around it, and does not come from below."""
        free = ~around.from_below(T)
        if around.table is not None:
            free &= self.clearance.free_of_plane(around.table, T, grasp_type, around.retreat)
        few = positions[:: max(1, len(positions) // self.config.coarse_points)]
        for points, test in (
            (few, self.clearance.free_of_points),
            (around.sparse(_SPARSE), self.clearance.free_of_obstacles),
            (positions, self.clearance.free_of_points),
            (around.obstacles, self.clearance.free_of_obstacles),
            (around.hidden, self.clearance.free_of_hidden),
        ):
            left = free.nonzero()[:, 0]
            free[left] = test(points, T[left], grasp_type[left])
        return free

    def closes(self, T: Tensor, grasp_type: Tensor, positions: Tensor) -> Tensor:
        """(G,) bool: enough of the points (N, 3) lie between the pads."""
        enough = torch.zeros(len(T), dtype=torch.bool)
        for code, hand in enumerate(self.hands):
            for part in parts((grasp_type == code).nonzero()[:, 0], len(positions)):
                count = hand.region.holds(*local(T[part], positions).unbind(1)).sum(1)
                enough[part] = count >= self.config.closing_points
        return enough

    def _found(self, T: Tensor, positions: Tensor, around: Surroundings) -> Hypotheses:
        T = T[~around.from_below(T)]
        found: list[list[Tensor]] = [[] for _ in self.hands]
        for part in parts(torch.arange(len(T)), len(positions)):
            at = local(T[part], positions)
            for code, poses in enumerate(found):
                poses.append(self._of_type(code, T[part], at, positions, around))
        each = [torch.cat(poses) if poses else T for poses in found]
        counts = torch.tensor([len(poses) for poses in each])
        return Hypotheses(torch.cat(each), torch.arange(len(each)).repeat_interleave(counts))

    def _of_type(self, code: int, T: Tensor, at: Tensor, positions: Tensor, around: Surroundings) -> Tensor:
        """Poses (H, 4, 4) of one grasp type, sorted by frame, depth and place; the positions lie at (F, 3, N) in T."""
        hand, grasp_type = self.hands[code], self.clearance.grasp_types[code]
        depths = torch.arange(self.config.deepest, self.config.shallowest - 1e-6, -self.config.depth_step)
        shift, possible = places(*profile(at, depths, hand.region), hand, self.config)  # (F, D, places)
        along = depths[:, None, None] * T[:, None, None, :3, 2]
        where = T[:, None, None, :3, 3] + (along + shift.unsqueeze(3) * T[:, None, None, :3, 0])
        if around.table is not None:
            least = self.clearance.least_height(around.table, T, grasp_type, around.retreat)
            possible &= where @ around.table.normal >= least[:, None, None]
        points = [part.float() for part in (positions, around.obstacles, around.hidden)]
        kept = deepest_free(T, where, possible, self.config.back, points, self.volumes[code])
        frame, k, place = kept.nonzero(as_tuple=True)
        return moved(T[frame], depths[k], shift[frame, k, place])


def frames(positions: Tensor, normals: Tensor, config: HypothesesConfig) -> Tensor:
    """T (F, 4, 4) f32 at the seeds: x along closing, z along the approach; none where the normals give no frame."""
    seeds = se3.pose(positions.double(), torch.tensor([1.0, 0, 0, 0]).double().expand(len(positions), 4)).clone()
    seeds[:, :3, 2] = normals
    at = farthest_point_sampling(seeds, config.seeds, config.normal_weight)
    near = (
        torch.cdist(positions[at], positions, compute_mode="donot_use_mm_for_euclid_dist") < config.normal_radius
    ).double()
    n = normals.double()
    bend = (near @ (n[:, :, None] * n[:, None, :]).flatten(1)).view(-1, 3, 3)
    normal = torch.nn.functional.normalize(near @ n, dim=1)
    axis = torch.linalg.eigh(bend).eigenvectors[:, :, 0]
    axis = axis - (axis * normal).sum(1, keepdim=True) * normal
    length = axis.norm(dim=1)
    good = (length > 1e-6) & (normal.norm(dim=1) > 0.5)
    at, normal, axis = at[good], normal[good], axis[good] / length[good, None]
    inward = ((positions.double().mean(0) - positions[at].double()) * axis).sum(1, keepdim=True)
    axis = torch.where(inward < 0, -axis, axis)  # an eigenvector has no sign of its own
    x, z = _axes(normal, axis, math.radians(config.tilt_deg))
    T = torch.eye(4).repeat(len(x), 1, 1)
    T[:, :3, :3] = torch.stack([x, torch.linalg.cross(z, x), z], dim=2).float()
    T[:, :3, 3] = positions[at].repeat(len(x) // max(1, len(at)), 1)
    return T


def _axes(normal: Tensor, axis: Tensor, tilt: float) -> tuple[Tensor, Tensor]:
    """Closing and approach axes (F, 3) of every hand tried about seeds of these normals and tangents (S, 3)."""
    other = torch.linalg.cross(normal, axis)
    x, z = [], []
    for closing in (axis, other):
        for angle in torch.linspace(-tilt, tilt, _TANGENT_TILTS).double():
            x.append(closing)
            z.append(angle.cos() * -normal + angle.sin() * torch.linalg.cross(-normal, closing))
    for tangent in (axis, other):
        for sign in (1, -1):
            for angle in torch.linspace(-_RIM * tilt, _RIM * tilt, _NORMAL_TILTS).double():
                x.append(normal)
                z.append(sign * (angle.cos() * tangent + angle.sin() * torch.linalg.cross(tangent, normal)))
    return torch.cat(x), torch.cat(z)


def profile(at: Tensor, depths: Tensor, region: ClosingRegion) -> tuple[Tensor, Tensor, Tensor]:
    """What is seen between the fingers, and a little beyond them, of hands pushed forward by depths (D,).

    Points lie at (F, 3, N) in the frames of hands that are not yet pushed.

    Returns:
        lowest and highest x (F, D) f32, m along closing from the TCP (infinite of nothing); how many points
        (F, D) int64.
    """
    edges = torch.tensor([region.middle, _BEYOND * region.half, region.height])
    first, last = ((depths.double() + end).float() for end in (region.low, region.high))
    return extents(at, edges, first, last)


def places(
    low: Tensor, high: Tensor, count: Tensor, hand: HandGeometry, config: HypothesesConfig
) -> tuple[Tensor, Tensor]:
    """Lateral shifts (F, D, places) of a hand, m, and whether what was seen (`profile`) then lies between its fingers.

    Places: what was seen in the middle; of a hand with pads also its highest face near the pad at +x, and its lowest
    near the pad at -x.
    """
    half, middle, gap = hand.region.half, hand.region.middle, config.face_gap
    shift = torch.stack([(low + high) / 2 - middle, high - (middle + half) + gap, low - (middle - half) - gap], dim=2)
    room = torch.tensor([0.0, gap, gap]) + config.play
    if not hand.region.pads:
        shift, room = shift[:, :, :1], room[:1]
    fits = (high - low).unsqueeze(2) <= 2 * (half - room)
    return shift.nan_to_num(0.0), fits & (count >= config.closing_points).unsqueeze(2)


def moved(T: Tensor, depth: Tensor, shift: Tensor) -> Tensor:
    """Poses (G, 4, 4) moved by `depth` (m, one or (G,)) along their approach and by shift (G,) along closing."""
    at = T.clone()
    at[:, :3, 3] += depth.reshape(-1, 1) * T[:, :3, 2] + shift.unsqueeze(1) * T[:, :3, 0]
    return at


def local(T: Tensor, positions: Tensor) -> Tensor:
    """(G, 3, N) f32: points (N, 3) in the TCP frames of poses (G, 4, 4)."""
    back = T[:, :3, :3].mT.contiguous()
    return (back.view(-1, 3) @ positions.T).view(len(T), 3, len(positions)) - back @ T[:, :3, 3:]


def parts(indices: Tensor, points: int) -> Iterator[Tensor]:
    """The indices (G,) in parts that are small enough to be looked at with so many points together."""
    yield from indices.split(max(1, _PAIRS // max(1, points))) if len(indices) else ()
