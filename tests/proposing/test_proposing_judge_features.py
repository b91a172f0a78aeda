"""The numbers of a hypothesis: each equals a slow loop over points, written from its definition."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from proposing_models import VOLUMES

from spgf_torch.geometry import se3
from spgf_torch.proposing.clearance import Clearance
from spgf_torch.proposing.config import HypothesesConfig
from spgf_torch.proposing.hypotheses import Hypotheses, Search, local
from spgf_torch.proposing.judge_features import GEOMETRY, NAMES, Seen, between_pads, in_images, judge_features
from spgf_torch.sensing.cameras import Camera, look_at
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.sensing.unseen import DepthView, behind
from spgf_torch.settings import settings

CONFIG = settings(HypothesesConfig)
SEARCH = Search.of(Clearance(VOLUMES, 0.005, 0.01), CONFIG)


def view(eye: list[float]) -> DepthView:
    """A wall with a step in it, across the line of sight, as a camera at `eye` sees it that looks at the origin."""
    camera = Camera(
        np.array([[150.0, 0, 39.5], [0, 150.0, 29.5], [0, 0, 1]]), look_at(np.array(eye), np.zeros(3)), 80, 60
    )
    return DepthView.of(np.where(np.arange(80) < 38, 0.41, 0.52) * np.ones((60, 1)), camera)


VIEWS = (view([0.4, 0.1, 0.3]), view([-0.2, 0.3, 0.35]))


def random_case(views: tuple[DepthView, ...] = VIEWS) -> tuple[Seen, Hypotheses]:
    generator = torch.Generator().manual_seed(5)
    positions = 0.02 * torch.randn(150, 3, generator=generator)
    normals = torch.nn.functional.normalize(positions + 0.003 * torch.randn(150, 3, generator=generator), dim=1)
    T = se3.random_poses(12, generator, extent=0.01)
    return Seen(Texlets(positions, normals), views), Hypotheses(T, torch.arange(12) % 2)


def slow(seen: Seen, T: torch.Tensor, kind: int) -> dict[str, float]:
    """One hypothesis, point by point."""
    hand = SEARCH.hands[kind]
    r, P, N = hand.region, seen.texlets.positions.double(), seen.texlets.normals.double()
    R, t = T[:3, :3].double(), T[:3, 3].double()
    points = [(p - t) @ R for p in P]
    found = dict.fromkeys(NAMES, 0.0) | {"type": float(kind)}
    pieces = [planes.double() for planes in VOLUMES[("NPG", "WPG")[kind]].planes]
    distances = [max(float(f[:3] @ p - f[3]) for f in piece) for piece in pieces for p in points]
    found["margin"] = min([CONFIG.margin, *distances])
    on = [i for i, p in enumerate(points) if abs(p[0]) < r.half and abs(p[1]) < r.height and r.low < p[2] < r.high]
    x, cosine = [float(points[i][0]) for i in on], [float(N[i] @ R[:, 0]) for i in on]
    found["log_points"] = math.log(1 + len(on))
    if on:
        low, high, edge = min(x), max(x), math.cos(math.atan(CONFIG.friction))
        found["width"], found["off_mid"] = (high - low) / (2 * r.half), abs(high + low) / 2
        found["mean_z"] = sum(float(points[i][2]) for i in on) / len(on)
        right = [c for v, c in zip(x, cosine, strict=True) if v > high - CONFIG.pad_depth]
        left = [-c for v, c in zip(x, cosine, strict=True) if v < low + CONFIG.pad_depth]
        anti = [sum(min(1, max(0, (c - edge) / (1 - edge))) for c in side) / len(side) for side in (right, left)]
        facing = [sum(side) / len(side) for side in (right, left)]
        found |= {"anti_min": min(anti), "anti_max": max(anti), "n_min": min(facing), "n_max": max(facing)}
        both = min(sum(c > 0.5 for c in cosine), sum(c < -0.5 for c in cosine))
        found |= {"both_sides": float(both > 0), "log_both": math.log(1 + both)}
    ahead = [
        float(p[2])
        for p in points
        if abs(p[0]) < r.half and abs(p[1]) < r.height and -CONFIG.near_fingers < p[2] < r.high
    ]
    found["reach"] = r.high - min([r.high, *ahead])
    c = (P.mean(0) - t) @ R
    found |= {"c_x": abs(float(c[0])), "c_y": abs(float(c[1])), "c_z": float(c[2]), "c_arm": math.hypot(c[1], c[2])}
    along = [float(p[0]) for p in points]
    found["span"] = (max(along) - min(along)) / (2 * r.half)
    size = torch.linalg.svdvals(P - P.mean(0)) / math.sqrt(len(P))
    found |= {f"size_{i + 1}": float(s) for i, s in enumerate(size)}
    if seen.views:
        found |= slow_unseen(seen, R, t, kind)
    return found


def slow_unseen(seen: Seen, R: torch.Tensor, t: torch.Tensor, kind: int) -> dict[str, float]:
    hand, P = SEARCH.hands[kind], seen.texlets.positions.double()
    depth = {
        name: [float(behind((R @ q.double() + t).float(), seen.views)) for q in getattr(hand, name)]
        for name in ("fingers", "palm", "sweep")
    }
    share = lambda values: sum(values) / max(1, len(values))  # noqa: E731
    fingers, towards = depth["fingers"], torch.zeros(3).double()
    for v in seen.views:
        towards += (v.eye.double() - P.mean(0)) / (v.eye.double() - P.mean(0)).norm() / len(seen.views)
    side = [
        [d > CONFIG.unseen for d, q in zip(fingers, hand.fingers, strict=True) if (q[0] < 0) == left]
        for left in (True, False)
    ]
    return {
        "views": len(seen.views),
        "from_seen": -float(R[:, 2] @ towards),
        "finger_near": share([CONFIG.unseen < d <= CONFIG.unseen_mid for d in fingers]),
        "finger_mid": share([CONFIG.unseen_mid < d <= CONFIG.unseen_far for d in fingers]),
        "finger_far": share([d > CONFIG.unseen_far for d in fingers]),
        "worst_finger": max(map(share, side)),
        "best_finger": min(map(share, side)),
        "palm": share([d > CONFIG.unseen for d in depth["palm"]]),
        "sweep": share([d > CONFIG.unseen for d in depth["sweep"]]),
        "sweep_depth": share([min(0.1, max(0.0, d)) for d in depth["sweep"]]),
    }


@pytest.mark.parametrize("views", [VIEWS, VIEWS[:1], ()], ids=["two", "one", "none"])
def test_equal_a_slow_loop(views: tuple[DepthView, ...]) -> None:
    seen, hypotheses = random_case(views)
    numbers = judge_features(seen, hypotheses, SEARCH)
    assert numbers.shape == (12, 31) and len(set(NAMES)) == 31
    # A single grid point on the edge of a pixel may fall to either side by rounding.
    loose = {"finger_near", "finger_mid", "finger_far", "worst_finger", "best_finger", "palm", "sweep", "sweep_depth"}
    for row, T, kind in zip(numbers, hypotheses.T, hypotheses.grasp_type.tolist(), strict=True):
        for name, got, expected in zip(NAMES, row.tolist(), slow(seen, T, kind).values(), strict=True):
            assert got == pytest.approx(expected, abs=0.02 if name in loose else 2e-5), name
    varied = (numbers.std(0) > 1e-4).tolist()
    same = {"size_1", "size_2", "size_3", "views", *(() if views else NAMES[len(GEOMETRY) :]), "palm"}
    assert {name for name, moves in zip(NAMES, varied, strict=True) if not moves} <= same


def test_nothing_between_the_pads() -> None:
    """A hand half a metre away: finite numbers, all of the pads' 0."""
    seen, hypotheses = random_case()
    hypotheses.T[:, :3, 3] += 0.5
    numbers = judge_features(seen, hypotheses, SEARCH)
    assert numbers.isfinite().all()
    empty = ("log_points", "width", "anti_max", "n_max", "both_sides", "reach")
    assert (numbers[:, [NAMES.index(name) for name in empty]] == 0).all()
    assert (numbers[:, NAMES.index("margin")] == np.float32(CONFIG.margin)).all()
    assert judge_features(seen, hypotheses.at(torch.zeros(0, dtype=torch.int64)), SEARCH).shape == (0, 31)


def test_fingers_beyond_the_border_of_all_images() -> None:
    """At 0.5 m the image is 0.27 m wide: a finger 0.2 m beside its middle is not in it."""
    seen, hypotheses = random_case((view([0.0, 0.3, 0.4]),))
    assert in_images(seen, hypotheses, SEARCH).all()
    hypotheses.T[:6, 0, 3] += 0.2
    assert in_images(seen, hypotheses, SEARCH).tolist() == [False] * 6 + [True] * 6
    assert in_images(Seen(seen.texlets), hypotheses, SEARCH).all()


def test_a_region_to_one_side_is_one_in_the_middle_moved() -> None:
    """Points 7 mm further along closing, between pads whose middle is 7 mm there, have the same numbers."""
    seen, hypotheses = random_case()
    hand, T = SEARCH.hands[1], hypotheses.T
    at, cosine = local(T, seen.texlets.positions), T[:, :3, 0] @ seen.texlets.normals.T
    aside = replace(hand, region=replace(hand.region, middle=0.007))
    moved = at + torch.tensor([0.007, 0.0, 0.0])[:, None]
    expected, found = between_pads(at, cosine, hand), between_pads(moved, cosine, aside)
    torch.testing.assert_close(found, expected, atol=1e-6, rtol=1e-5)
    assert not torch.allclose(between_pads(moved, cosine, hand), expected, atol=1e-3)
    torch.testing.assert_close(aside.sweep, hand.sweep + torch.tensor([0.007, 0.0, 0.0]))
