"""Which objects fit a hand, by their true mesh and the hand's shape alone: no trial and no judge takes part.

An object fits, alone or on a table, where the hand has `config.best` grasps of it that are no two the same: two places
of its surface, opposite each other within the friction cone, that leave the open hand `play` on either side; the open
hand, with the middle of its pads or two thirds of the way to their ends midway between them, cuts nothing of the
object, and stays above the table.
"""

from __future__ import annotations

import math

import numpy as np
import torch
import trimesh
from torch import Tensor

from spgf_torch.hands.config import grasp_types
from spgf_torch.hands.hand import Hand
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.proposing.clearance import Plane
from spgf_torch.proposing.hypotheses import Hypotheses, Search, moved
from spgf_torch.proposing.sampling import non_maximum_suppression
from spgf_torch.simulation.candidates import SKIN
from spgf_torch.simulation.precheck import PreCheck

# Places on an object's surface that are looked at, and approaches about the closing axis of each.
PAIRS, APPROACHES = 200, 12
# Where on the pads these places come to lie: shares of the way from the TCP to the pads' ends.
ON_PADS = (0.0, 2 / 3)
# Grasps looked at first, times those asked for: where they are enough, thousands need not be compared with each other.
FIRST = 20


def fits(obj: GraspObject, hand: Hand, search: Search, config: JudgeConfig) -> dict[bool, bool]:
    """Whether an object fits the hand: on a table (True), and alone (False)."""
    T, width = opposite_places(obj, config.hypotheses.friction)
    found = []
    for code, name in enumerate(grasp_types(hand.config)):
        region, check = search.hands[code].region, PreCheck(obj, hand.preshapes[name])
        within = T[width <= 2 * (region.half - config.hypotheses.play)]
        its = torch.cat([moved(within, torch.tensor(-share * region.high), torch.zeros(1)) for share in ON_PADS])
        its = its[torch.tensor([not check.collides(pose) for pose in its.double().numpy()], dtype=torch.bool)]
        found.append(Hypotheses(its, torch.full((len(its),), code)))
    grasps = Hypotheses(torch.cat([its.T for its in found]), torch.cat([its.grasp_type for its in found]))
    table = Plane.of((0.0, 0.0, 1.0), float(obj.mesh.bounds[0, 2]))
    above = search.clearance.free_of_plane(table, grasps.T, grasps.grasp_type)
    return {
        False: enough(grasps, search, config),
        True: enough(grasps.at(above), search, config),
    }


def enough(grasps: Hypotheses, search: Search, config: JudgeConfig) -> bool:
    """Whether `config.best` of the grasps are no two the same: those kept of the first ones are kept of all."""
    for count in (min(FIRST * config.best, len(grasps)), len(grasps)):
        its = grasps.at(torch.arange(count))
        same = torch.zeros_like(its.grasp_type)
        limits = config.proposing.apart, config.proposing.apart_deg
        symmetry = search.clearance.symmetry(its.grasp_type)
        if count and len(non_maximum_suppression(its.T, same, same.float(), *limits, symmetry)) >= config.best:
            return True
    return False


def opposite_places(obj: GraspObject, friction: float) -> tuple[Tensor, Tensor]:
    """Poses (G, 4, 4) f32 midway between opposite places of the surface, closing along their normal; widths (G,), m."""
    points, faces = trimesh.sample.sample_surface(obj.mesh, PAIRS, seed=0)
    normal = obj.mesh.face_normals[faces]
    hits, rays, met = obj.mesh.ray.intersects_location(points - SKIN * normal, -normal, multiple_hits=False)
    against = -(obj.mesh.face_normals[met] * normal[rays]).sum(axis=1) >= math.cos(math.atan(friction))
    hits, rays = hits[against], rays[against]
    x, angle = normal[rays], np.arange(APPROACHES) * 2 * math.pi / APPROACHES
    aside = np.cross(x, np.eye(3)[np.abs(x).argmin(axis=1)])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    z = np.cos(angle)[:, None, None] * aside + np.sin(angle)[:, None, None] * np.cross(x, aside)
    T = np.tile(np.eye(4), (*z.shape[:2], 1, 1))
    T[..., :3, :3] = np.stack([np.broadcast_to(x, z.shape), np.cross(z, x), z], axis=-1)
    T[..., :3, 3] = (points[rays] + hits) / 2
    width = np.tile(np.linalg.norm(hits - points[rays], axis=1), APPROACHES)
    return torch.from_numpy(T.reshape(-1, 4, 4)).float(), torch.from_numpy(width)
