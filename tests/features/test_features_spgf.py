"""The whole feature: against the loop reference, on shapes worked out by hand, symmetries, degenerate input."""

import math

import numpy as np
import pytest
import spgf_reference
import torch

from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import Features, spgf
from spgf_torch.geometry import se3
from spgf_torch.ops import describe, neighbours
from spgf_torch.ops.pairwise_relations import reference_frames, turned
from spgf_torch.settings import settings

RIGHT = math.pi / 2
ARGMAX = settings(FeatureConfig)
SOFT = settings(FeatureConfig, alignment="soft")
unit = torch.nn.functional.normalize


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def random_cloud(N: int, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    """Points in a ball of 4 cm, normals any way: every layer, every angle, and gaps where N is small."""
    points = 0.04 * unit(torch.randn((N, 3), generator=generator(seed), dtype=torch.float64), dim=1)
    points *= torch.rand((N, 1), generator=generator(seed + 1), dtype=torch.float64)
    return points, unit(torch.randn((N, 3), generator=generator(seed + 2), dtype=torch.float64), dim=1)


def box_surface(N: int = 1500, noise: float = 0.05, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    """A noisy 10 x 6 x 4 cm box open at its top, both sides of the walls seen: edges, corners, rims, gaps."""
    size = torch.tensor([0.10, 0.06, 0.04], dtype=torch.float64)
    side = torch.randint(5, (N,), generator=generator(seed))
    axis, sign = side // 2, (side % 2 * 2 - 1).double()  # -x, +x, -y, +y, -z; no +z
    points = (torch.rand((N, 3), generator=generator(seed + 1), dtype=torch.float64) - 0.5) * size
    rows = torch.arange(N)
    points[rows, axis] = sign * size[axis] / 2
    normals = torch.zeros_like(points)
    normals[rows, axis] = sign
    inside = torch.rand(N, generator=generator(seed + 2)) < 0.4
    points[inside] -= 0.002 * normals[inside]
    normals[inside] *= -1
    normals += noise * torch.randn((N, 3), generator=generator(seed + 3), dtype=torch.float64)
    return points + 5e-4 * torch.randn((N, 3), generator=generator(seed + 4)).double(), unit(normals, dim=1)


def loop_frames(X: torch.Tensor, n: torch.Tensor) -> torch.Tensor:
    """Reference frames (N, 3, 3) towards the mean of the neighbours."""
    near = (torch.cdist(X, X) <= ARGMAX.radius) & ~torch.eye(len(X), dtype=torch.bool)
    towards = [X[row].mean(dim=0) - x if row.any() else torch.zeros(3) for x, row in zip(X, near, strict=True)]
    return torch.from_numpy(reference_frames(n.numpy(), torch.stack(towards).to(n).numpy()))


def turned_spgf(angle: torch.Tensor, X: torch.Tensor, n: torch.Tensor, config: FeatureConfig) -> Features:
    """Features whose R_x is turned by the angle (N,), rad: a texlet is known by its normal."""

    def frames(normals: torch.Tensor, towards: torch.Tensor) -> torch.Tensor:
        own = torch.from_numpy(reference_frames(normals.numpy(), towards.numpy()))
        return turned(own, angle[torch.cdist(normals, n).argmin(dim=1)])

    def in_loops(normals: np.ndarray, towards: np.ndarray) -> np.ndarray:
        return frames(torch.from_numpy(normals), torch.from_numpy(towards)).numpy()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(describe, "reference_frames", in_loops)
        patch.setattr(describe, "frames_in_torch", frames)
        return spgf(X, n, config)


def change(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Root mean square difference of the relational parts of each feature, in degrees."""
    return torch.rad2deg((a.relations() - b.relations()).square().mean(dim=1).sqrt())


# --- against the loops -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cells", [36, 7])
@pytest.mark.parametrize("half_length", [6, 0, 2])
@pytest.mark.parametrize("N", [12, 70])
def test_equals_the_loop_reference(N, half_length, cells):
    """Sparse clouds have gaps and ties in nearly every ring, dense ones in none."""
    X, n = random_cloud(N)
    frames = loop_frames(X, n)
    expected_rings, expected_T, expected_valid = spgf_reference.spgf(
        X.numpy(), n.numpy(), frames.numpy(), N, cells=cells, half_length=half_length
    )
    features = spgf(X, n, settings(FeatureConfig, cells=cells, half_length=half_length))
    assert np.array_equal(features.valid.numpy(), expected_valid)
    # acos in the reference is good to 1e-8 near 0 and pi.
    assert np.allclose(features.rings.numpy(), expected_rings, atol=1e-6)
    assert np.allclose(features.T_object_feature.numpy(), expected_T, atol=1e-12)


@pytest.mark.parametrize("alignment", ["argmax", "soft", "random"])
def test_one_and_two_threads_give_the_same_bits(monkeypatch, alignment):
    X, n = box_surface(700)
    monkeypatch.setattr(neighbours, "CANDIDATES", 1 << 14)
    config, found = settings(FeatureConfig, alignment=alignment), []
    before = torch.get_num_threads()
    for threads in (1, 2):
        torch.set_num_threads(threads)
        found.append(spgf(X.float(), n.float(), config, generator()))
        assert torch.get_num_threads() == threads
    torch.set_num_threads(before)
    assert torch.equal(found[0].rings, found[1].rings)
    assert torch.equal(found[0].T_object_feature, found[1].T_object_feature)


def test_equals_the_loop_reference_on_a_shape_with_walls_and_rims():
    X, n = box_surface(500)
    frames = loop_frames(X, n)
    rings, T, _ = spgf_reference.spgf(X.numpy(), n.numpy(), frames.numpy(), 60)
    features = spgf(X, n, ARGMAX)
    assert np.allclose(features.rings[:60].numpy(), rings, atol=1e-6)
    assert np.allclose(features.T_object_feature[:60].numpy(), T, atol=1e-12)


def test_float32_agrees_with_float64():
    """Where the two take the same start cell they agree to 1e-3 rad in 99 %; the rest sat on a cell's border."""
    X, n = box_surface()
    X, n = X.float(), unit(n.float(), dim=1)
    single, double = spgf(X, n, ARGMAX), spgf(X.double(), unit(n.double(), dim=1), ARGMAX)
    assert single.rings.dtype == torch.float32
    assert double.rings.dtype == torch.float64
    close = (single.rings - double.rings).abs().amax(dim=(1, 2, 3)) < 1e-3
    assert close.float().mean() > 0.99


@pytest.mark.parametrize("config", [ARGMAX, SOFT], ids=["argmax", "soft"])
def test_does_not_depend_on_how_the_work_is_cut(config, monkeypatch):
    X, n = box_surface(600)
    whole = spgf(X, n, config)
    monkeypatch.setattr(neighbours, "CANDIDATES", 999)
    cut = spgf(X, n, config)
    assert torch.allclose(cut.rings, whole.rings, atol=1e-9)
    assert torch.allclose(cut.T_object_feature, whole.T_object_feature, atol=1e-9)
    assert torch.equal(cut.valid, whole.valid)


# --- shapes worked out by hand -----------------------------------------------------------------------------------


def flat_disc(from_deg: float = 0, to_deg: float = 360, offset=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)):
    """Points at 1 and 2 cm around the origin in the plane z = 0, every 2.5 deg off the cells' borders."""
    direction = torch.deg2rad(torch.arange(from_deg + 1.25, to_deg, 2.5, dtype=torch.float64))
    ring = torch.stack([direction.cos(), direction.sin(), torch.zeros_like(direction)], dim=1)
    points = torch.cat([0.01 * ring, 0.02 * ring]) + torch.tensor(offset, dtype=torch.float64)
    return points, torch.tensor([normal], dtype=torch.float64).expand_as(points)


def first_of(*parts, centre=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), config=ARGMAX):
    """The feature of a texlet at `centre` among the others: rings (2, cells, 2) in degrees and pose."""
    X = torch.cat([torch.tensor([centre], dtype=torch.float64), *(part[0] for part in parts)])
    n = torch.cat([torch.tensor([normal], dtype=torch.float64), *(part[1] for part in parts)])
    features = spgf(X, n, config)
    return torch.rad2deg(features.rings[0]), features.T_object_feature[0]


def test_a_plane():
    """alpha1 = alpha2 = 0 all round; nothing faces away: the bottom is one gap, 90 and 180 deg."""
    rings, T = first_of(flat_disc())
    assert torch.allclose(rings[0], torch.zeros(36, 2, dtype=torch.float64), atol=1e-9)
    assert torch.allclose(rings[1], torch.tensor([90.0, 180.0], dtype=torch.float64).expand(36, 2))
    assert torch.allclose(T[:3, 2], torch.tensor([0.0, 0, 1]).double())


@pytest.mark.parametrize("config", [ARGMAX, SOFT], ids=["argmax", "soft"])
def test_a_convex_edge_is_where_x_points(config):
    """Top face z = 0 ends at x = 1 cm in a face with normal +x. A neighbour 1 cm down it, at (1, 0, -1) cm, lies
    45 deg below (alpha1 = 45) with alpha2 = 90. The other neighbours are the plane's, on the side away from it:
    without averaging cell 0 (towards the edge) holds (45, 90) and the cells behind hold (0, 0)."""
    edge = torch.tensor([[0.01, 0.0, -0.01]]).double(), torch.tensor([[1.0, 0.0, 0.0]]).double()
    bare = settings(FeatureConfig, alignment=config.alignment, half_length=0, gaps="flat")
    rings, T = first_of(flat_disc(20, 340), edge, config=bare)
    assert torch.allclose(T[:3, 0], torch.tensor([1.0, 0, 0]).double(), atol=1e-9)
    assert torch.allclose(rings[0, 0], torch.tensor([45.0, 90.0]).double())
    assert torch.allclose(rings[0, 3:34], torch.zeros(31, 2).double(), atol=1e-9)


def test_a_concave_edge_has_negative_elevation():
    """A wall with normal -x rising from the plane at x = 1 cm: (1, 0, 1) cm is 45 deg above, alpha2 = 90."""
    wall = torch.tensor([[0.01, 0.0, 0.01]]).double(), torch.tensor([[-1.0, 0.0, 0.0]]).double()
    rings, _ = first_of(flat_disc(20, 340), wall, config=settings(FeatureConfig, half_length=0, gaps="flat"))
    assert torch.allclose(rings[0, 0], torch.tensor([-45.0, 90.0]).double())


@pytest.mark.parametrize("config", [ARGMAX, SOFT], ids=["argmax", "soft"])
def test_the_rim_of_a_thin_wall(config):
    """A wall 4 mm thick in the plane z = 0, rim along the x axis, material at y < 0; the centre on the rim.

    Front neighbours fill 180..360 deg, the moving average 60 deg more on each side, and what remains around
    +y is a gap: x_feature = +y. Behind (cell 18) the front is flat, (0, 0), and the back face, 4 mm below, gives
    alpha2 = 180 and per cell the mean of atan(4/10) and atan(4/20) = 16.556 deg, all neighbours alike."""
    back = flat_disc(180, 360, offset=(0.0, 0.0, -0.004), normal=(0.0, 0.0, -1.0))
    rings, T = first_of(flat_disc(180, 360), back, config=config)
    # Front neighbours reach 1.25 deg from the x axis: their cells are 18..36, and the gap is cells 7..11 of +x.
    assert torch.allclose(T[:3, 0], torch.tensor([0.0, 1, 0]).double(), atol=1e-9)
    assert torch.allclose(rings[0, 18], torch.zeros(2).double(), atol=1e-9)
    assert torch.allclose(rings[0, 0], torch.tensor([90.0, 90.0]).double())
    expected = torch.tensor([(math.degrees(math.atan(0.4)) + math.degrees(math.atan(0.2))) / 2, 180.0]).double()
    assert torch.allclose(rings[1, 18], expected)
    assert torch.allclose(rings[1, 0], torch.tensor([90.0, 180.0]).double())


def test_a_cylinder_seen_from_its_side_bends_across_its_axis():
    """Radius 3 cm, axis z, centre at (3, 0, 0): the highest curvature is across the axis, so x_feature = +-y."""
    angle, height = torch.meshgrid(
        torch.deg2rad(torch.linspace(-60, 60, 49, dtype=torch.float64)),
        torch.linspace(-0.03, 0.03, 25, dtype=torch.float64),
        indexing="ij",
    )
    n = torch.stack([angle.cos(), angle.sin(), torch.zeros_like(angle)], dim=2).view(-1, 3)
    X = 0.03 * n + torch.stack([torch.zeros_like(height)] * 2 + [height], dim=2).view(-1, 3)
    keep = (X - torch.tensor([0.03, 0, 0])).norm(dim=1) > 1e-4
    rings, T = first_of((X[keep], n[keep]), centre=(0.03, 0.0, 0.0), normal=(1.0, 0.0, 0.0))
    assert T[1, 0].abs() == pytest.approx(1.0, abs=math.cos(math.radians(10)) / 10)
    assert rings[0, 0, 1] > rings[0, 9, 1] + 10  # far more across than along the axis


# --- symmetries --------------------------------------------------------------------------------------------------


def test_turning_everything_with_its_frames_changes_nothing_but_the_pose():
    X, n = box_surface()
    T = se3.random_poses(1, generator(5)).double()[0]
    T = se3.pose(se3.position_of(T), se3.quaternion_of(T))  # orthonormal in float64
    before = spgf(X, n, ARGMAX)
    after = spgf(se3.transform_points(T, X), n @ se3.rotation_of(T).mT, ARGMAX)
    same = (after.rings - before.rings).abs().amax(dim=(1, 2, 3)) < 1e-6
    assert same.float().mean() > 0.998  # a neighbour on a cell's border may change cells
    moved = T @ before.T_object_feature
    assert torch.allclose(after.T_object_feature[same], moved[same], atol=1e-6)


def test_the_tie_rule_does_not_depend_on_the_reference_direction():
    """R_x turned by whole cells leaves the cells' contents alone, so rings and poses must be the same, also where
    gaps tie: the sparse cloud has a gap in nearly every top ring."""
    for X, n in (box_surface(700), random_cloud(40)):
        before = spgf(X, n, ARGMAX)
        assert (before.rings[:, 0, :, 1] == RIGHT).any(dim=1).float().mean() > 0.1
        for cells in (1, 7, 18, 35):
            after = turned_spgf(torch.full((len(X),), cells * math.pi / 18, dtype=torch.float64), X, n, ARGMAX)
            same = (after.rings - before.rings).abs().amax(dim=(1, 2, 3)) < 1e-9
            assert same.float().mean() > 0.995
            assert torch.allclose(after.T_object_feature[same], before.T_object_feature[same], atol=1e-9)


def test_soft_alignment_hardly_depends_on_the_reference_direction():
    """Any R_x: half of the features change by less than 1.5 deg and nine in ten by less than 3.5 (measured 1.0
    and 2.5, of 20 that two features differ by); the argmax on fixed cells changes more (2.7 and 8.7)."""
    X, n = box_surface()
    angle = 2 * math.pi * torch.rand(len(X), generator=generator(9), dtype=torch.float64)
    soft = change(turned_spgf(angle, X, n, SOFT), spgf(X, n, SOFT))
    hard = change(turned_spgf(angle, X, n, ARGMAX), spgf(X, n, ARGMAX))
    assert soft.median() < 1.5
    assert soft.quantile(0.9) < 3.5
    assert soft.median() < hard.median() / 2
    assert soft.quantile(0.9) < hard.quantile(0.9) / 2


@pytest.mark.parametrize("config", [ARGMAX, SOFT], ids=["argmax", "soft"])
def test_the_order_of_texlets_does_not_matter(config):
    X, n = box_surface(600)
    order = torch.randperm(600, generator=generator(3))
    straight, shuffled = spgf(X, n, config), spgf(X[order], n[order], config)
    assert torch.allclose(shuffled.rings, straight.rings[order], atol=1e-9)
    assert torch.allclose(shuffled.T_object_feature, straight.T_object_feature[order], atol=1e-9)


# --- degenerate input --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("config", [ARGMAX, SOFT], ids=["argmax", "soft"])
def test_texlets_without_a_direction_are_flagged_gaps(config):
    """Alone, with a twin at the same place, with a neighbour straight behind: no alpha3, every cell a gap."""
    X = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, -0.002]])
    n = torch.tensor([[0.0, 0, 1], [0, 0, 1], [0, 1, 0], [0, 0, 1], [0, 0, -1]])
    features = spgf(X, n, config)
    assert not features.valid.any()
    assert torch.allclose(features.rings[:, 0], torch.tensor([RIGHT, RIGHT]).expand(5, 36, 2))
    assert torch.allclose(features.rings[:, 1], torch.tensor([RIGHT, math.pi]).expand(5, 36, 2))
    assert torch.allclose(se3.position_of(features.T_object_feature), X)
    assert torch.allclose(features.T_object_feature[:, :3, 2], n)


def test_exactly_perpendicular_normals_stay_in_the_top_layer_under_rotation():
    """In float32 n1 . n2 of perpendicular normals comes out at +-1e-8: a threshold at 90 deg would flip them."""
    X = torch.tensor([[0.0, 0, 0], [0.01, 0, -0.01]])
    n = torch.tensor([[0.0, 0, 1], [1, 0, 0]])
    for T in se3.random_poses(50, generator()):
        features = spgf(se3.transform_points(T, X), unit(n @ se3.rotation_of(T).mT, dim=1), ARGMAX)
        assert (features.rings[0, 1, :, 1] == math.pi).all()
        assert features.rings[0, 0, 18, 1] == pytest.approx(RIGHT, abs=1e-5)


@pytest.mark.parametrize("config", [ARGMAX, SOFT], ids=["argmax", "soft"])
def test_no_texlets_give_no_features(config):
    features = spgf(torch.zeros((0, 3)), torch.zeros((0, 3)), config)
    assert features.rings.shape == (0, 2, 36, 2)
    assert features.relations().shape == (0, 144)
    assert features.T_object_feature.shape == (0, 4, 4)
    assert len(features) == 0


@pytest.mark.parametrize(
    ("positions", "normals", "config", "message"),
    [
        (torch.zeros((4, 2)), torch.zeros((4, 2)), ARGMAX, r"positions: expected shape \(N, 3\)"),
        (torch.zeros((4, 3)), torch.eye(3), ARGMAX, r"normals: expected shape \(N, 3\)"),
        (torch.zeros((3, 3)), torch.eye(3).double(), ARGMAX, "normals: expected float32 or float64"),
        (torch.zeros((3, 3)), 2 * torch.eye(3), ARGMAX, "normals: expected unit vectors, got one of length 2"),
        (torch.zeros((3, 3)), torch.full((3, 3), math.nan), ARGMAX, "normals: expected unit vectors"),
        (torch.full((3, 3), math.inf), torch.eye(3), ARGMAX, "points: expected finite coordinates"),
        (torch.zeros((3, 3)), torch.eye(3), settings(FeatureConfig, alignment="random"), "expected a generator"),
    ],
)
def test_unusable_input_is_named(positions, normals, config, message):
    with pytest.raises(InputError, match=message):
        spgf(positions, normals, config)


# --- settings for ablations --------------------------------------------------------------------------------------


def test_one_layer_ignores_what_faces_away():
    X, n = box_surface(500)
    both, top = spgf(X, n, ARGMAX), spgf(X, n, settings(FeatureConfig, layers=1))
    assert torch.equal(top.rings[:, 0], both.rings[:, 0])
    assert torch.allclose(top.rings[:, 1], torch.tensor([RIGHT, math.pi]).double().expand(500, 36, 2))


def test_flat_gaps_leave_no_gap():
    X, n = random_cloud(30)
    flat = spgf(X, n, settings(FeatureConfig, gaps="flat")).rings
    assert (spgf(X, n, ARGMAX).rings[:, 0, :, 0] == RIGHT).any()
    assert not (flat[:, 0, :, 0] == RIGHT).any()
    assert (flat[:, 0] == 0).all(dim=2).any()


def test_random_alignment_turns_rings_and_pose_together():
    """The random axis takes another start of the same rings: turned back by the angle between the poses' x axes,
    they are the aligned ones; and the generator alone decides."""
    X, n = box_surface(300)
    random = settings(FeatureConfig, alignment="random")
    first, second = (spgf(X, n, random, generator(4)) for _ in range(2))
    assert torch.equal(first.rings, second.rings)
    aligned = spgf(X, n, ARGMAX)
    relative = se3.inverse(aligned.T_object_feature) @ first.T_object_feature
    turn = (torch.atan2(relative[:, 1, 0], relative[:, 0, 0]) / (math.pi / 18)).round().long() % 36
    assert len(turn.unique()) == 36
    for row in range(300):
        assert torch.equal(first.rings[row], aligned.rings[row].roll(-int(turn[row]), dims=1))
