"""Registration by matched feature poses: known motions of a bracket, views of cameras, what is symmetric."""

import math
import re
import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image
from scipy.spatial import cKDTree

from spgf_torch.errors import InputError
from spgf_torch.features import registration
from spgf_torch.features.interface import VectorFeatures
from spgf_torch.features.registration import agreed, matched_motions, refine, register
from spgf_torch.geometry.se3 import (
    from_rotation,
    inverse,
    random_poses,
    relative_angle,
    rotation_about,
    rotation_of,
    transform_points,
)
from spgf_torch.sensing.cameras import surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import observe
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.settings import settings

ROOT = Path(__file__).parents[2]


def draws(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def moved(view: Texlets, T: torch.Tensor) -> Texlets:
    return Texlets(transform_points(T, view.positions), view.normals @ rotation_of(T).mT)


def bracket() -> Texlets:
    """Three plates at right angles, 8 x 4, 4 x 5 and 3 x 2 cm, 5 mm between texlets: nothing slides, no symmetry."""
    long, wide, none = 0.005 * torch.arange(17.0), 0.005 * torch.arange(9.0), torch.zeros(1)
    plates = [
        torch.cartesian_prod(long, wide, none),
        torch.cartesian_prod(wide, none, 0.005 * torch.arange(1, 11.0)),
        torch.cartesian_prod(none, 0.005 * torch.arange(1, 7.0), 0.005 * torch.arange(1, 5.0)),
    ]
    normals = [axis.repeat(len(plate), 1) for axis, plate in zip(torch.eye(3).flip(0), plates, strict=True)]
    return Texlets(torch.cat(plates), torch.cat(normals))


def views(mesh: trimesh.Trimesh, apart_deg: float) -> tuple[Texlets, Texlets]:
    """A mesh in its own frame as two noisy cameras see it, so many degrees of azimuth apart."""
    sensing = settings(SensingConfig, cameras=1)
    found = []
    for azimuth in (20.0, 20.0 + apart_deg):
        camera = surround(settings(SensingConfig, cameras=1, azimuth_deg=azimuth), mesh.bounds.mean(axis=0))
        found.append(observe(mesh, camera, sensing, np.random.default_rng(int(azimuth))))
    return found[0], found[1]


def eye(mesh: trimesh.Trimesh, azimuth_deg: float) -> torch.Tensor:
    camera = surround(settings(SensingConfig, cameras=1, azimuth_deg=azimuth_deg), mesh.bounds.mean(axis=0))[0]
    return torch.from_numpy(camera.T_object_camera[:3, 3].copy())


def surface_distance(mesh: trimesh.Trimesh, T: torch.Tensor) -> float:
    """Of a mesh and the same mesh moved by T: how far one is from the other at most, m."""
    dense = np.asarray(trimesh.sample.sample_surface(mesh, 20_000, seed=0)[0])
    some = torch.from_numpy(dense[:500])
    there, back = transform_points(T, some), transform_points(inverse(T), some)
    return float(cKDTree(dense).query(torch.cat([there, back]).numpy())[0].max())


@pytest.mark.parametrize("seed", [0, 1])
def test_a_known_motion_is_found_to_the_last_digits(seed: int) -> None:
    a = bracket()
    T = random_poses(1, draws(seed), extent=0.5)[0]
    found = register(a, moved(a, inverse(T)))
    assert (found.T_a_b - T.double()).abs().max() < 1e-5
    assert found.overlap == 1.0 and found.agreeing > len(a)
    assert found.T_a_b.dtype == torch.float64


def test_without_refinement_it_is_the_mean_of_the_matches() -> None:
    a = bracket()
    T = random_poses(1, draws(2), extent=0.5)[0]
    rough = register(a, moved(a, inverse(T)), steps=0).T_a_b
    assert (rough - T.double()).abs().max() > 1e-5
    assert relative_angle(rough, T.double()) < math.radians(5)


def test_two_noisy_views_of_blocks() -> None:
    sizes, places = [(10, 3, 2), (2, 3, 9), (2, 8, 3)], [(5, 0, 1), (1, 0, 4.5), (9, 2.5, 1.5)]
    shifts = [trimesh.transformations.translation_matrix(0.01 * np.array(at)) for at in places]
    blocks = [trimesh.creation.box(0.01 * np.array(size), at) for size, at in zip(sizes, shifts, strict=True)]
    mesh = trimesh.util.concatenate(blocks)
    a, b = views(mesh, 40.0)
    T = random_poses(1, draws(3), extent=0.5)[0]
    found = register(a, moved(b, inverse(T))).T_a_b
    assert relative_angle(found, T.double()) < math.radians(3)
    assert surface_distance(mesh, found @ inverse(T.double())) < 0.005


def test_a_can_is_right_but_for_its_turn() -> None:
    """Its pose about the axis is anything, so that the surface is what can be judged."""
    mesh = trimesh.creation.cylinder(0.033, 0.1, sections=96)
    a, b = views(mesh, 60.0)
    T = random_poses(1, draws(4), extent=0.5)[0]
    error = register(a, moved(b, inverse(T))).T_a_b @ inverse(T.double())
    assert surface_distance(mesh, error) < 0.006
    about, across = (from_rotation(rotation_about(w), torch.zeros(3)).double() for w in torch.eye(3)[[2, 0]])
    assert surface_distance(mesh, about) < 0.003 and surface_distance(mesh, across) > 0.02


def test_viewpoints_tell_where_a_handle_cannot_be() -> None:
    """A cup with a handle at the rim of what either view shows: without them, the wall alone overlaps better."""
    wall = trimesh.creation.annulus(0.035, 0.04, 0.09, sections=96)
    handle = trimesh.creation.box((0.03, 0.012, 0.05), trimesh.transformations.translation_matrix((0.05, 0, 0)))
    mesh = trimesh.util.concatenate([wall, handle])
    a, b = views(mesh, 60.0)
    eyes = torch.stack([eye(mesh, 20.0), eye(mesh, 80.0)])
    T = random_poses(1, draws(7), extent=0.5)[0]
    b, eyes[1] = moved(b, inverse(T)), transform_points(inverse(T).double(), eyes[1:])[0]
    without, known = register(a, b), register(a, b, viewpoints=(eyes[0], eyes[1]))
    assert surface_distance(mesh, known.T_a_b @ inverse(T.double())) < 0.008
    assert surface_distance(mesh, without.T_a_b @ inverse(T.double())) > 0.02
    assert known.denied < 0.05 and without.denied == 0 and without.overlap > known.overlap


def test_matches_are_those_of_a_slow_loop() -> None:
    """Either view's features with their two nearest of the other, each pair once; a feature that is not valid never."""
    generator = draws(5)
    a, b = (
        VectorFeatures(random_poses(n, generator), torch.rand(n, 3, generator=generator), torch.ones(n) > 0)
        for n in (7, 4)
    )
    a.valid[2] = False
    known = [i for i in range(7) if i != 2]
    apart = {(i, j): float((a.vectors[i] - b.vectors[j]).norm()) for i in known for j in range(4)}
    pairs = {(i, j) for i in known for j in sorted(range(4), key=lambda j: apart[i, j])[:2]}
    pairs |= {(i, j) for j in range(4) for i in sorted(known, key=lambda i: apart[i, j])[:2]}
    expected = [a.T_object_feature[i].double() @ b.T_object_feature[j].double().inverse() for i, j in sorted(pairs)]
    torch.testing.assert_close(matched_motions(a, b, 2), torch.stack(expected), rtol=0, atol=1e-6)


def test_the_most_agreed_comes_first() -> None:
    """Three motions within 15 mm and 15 deg about (10 mm, 0, 0), two elsewhere; a turn of 20 deg agrees with none."""
    turns = torch.tensor([-10.0, 0.0, 10.0, 0.0, 0.0, 20.0]).deg2rad()
    x = torch.tensor([0.005, 0.01, 0.015, 1.0, 1.0, 3.0])
    T = from_rotation(
        rotation_about(turns[:, None] * torch.tensor([0.0, 0, 1])), x[:, None] * torch.tensor([1.0, 0, 0])
    )
    found, agreeing = agreed(T.double(), torch.zeros(3, dtype=torch.float64))
    assert agreeing.tolist() == [3, 2, 1]
    middle = torch.eye(4, dtype=torch.float64)
    middle[0, 3] = 0.01
    torch.testing.assert_close(found[0], middle, rtol=0, atol=1e-7)


def test_refinement_mends_a_few_millimetres_and_degrees() -> None:
    a = bracket()
    off = from_rotation(rotation_about(torch.tensor([0.02, -0.03, 0.03])), torch.tensor([0.002, 0.001, -0.002]))
    assert (refine(a, a, off) - torch.eye(4)).abs().max() < 1e-4
    assert torch.equal(refine(a, a, off, steps=0), off.double())


def test_refinement_leaves_alone_what_nothing_lies_on() -> None:
    a, away = bracket(), torch.eye(4)
    away[0, 3] = 1.0
    assert torch.equal(refine(a, a, away), away.double())


def test_what_cannot_be_registered_is_told() -> None:
    a = bracket()
    lone = Texlets(a.positions[:1], a.normals[:1])
    with pytest.raises(InputError, match="expected features in both views, got none in b"):
        register(a, lone)
    for asked, got in (
        ({"matches": 0}, "0, 0.0075, 30"),
        ({"near": 0.0}, "2, 0.0, 30"),
        ({"steps": -1}, "2, 0.0075, -1"),
    ):
        with pytest.raises(InputError, match=f"matches >= 1, near > 0, steps >= 0; got {got}$"):
            register(a, a, **asked)
    assert register(a, a, matches=1, steps=0).overlap == 1


def test_the_example_of_the_docs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(ROOT / "docs/registration.py"))["main"]("saucepan", 40.0, tmp_path / "picture.png")
    turned, moved_by = map(float, re.findall(r"off by (\S+) deg and (\S+) mm", capsys.readouterr().out)[0])
    assert turned < 5 and moved_by < 5
    with Image.open(tmp_path / "picture.png") as picture:
        assert min(picture.size) > 300 and len(np.unique(np.asarray(picture))) > 10


def test_candidates_are_bounded() -> None:
    T = random_poses(200, draws(6)).double()
    assert len(agreed(T, torch.zeros(3, dtype=torch.float64))[0]) == registration.CANDIDATES


def test_what_the_camera_looked_through() -> None:
    """A wall 1 m before the eye, 40 mm wide: the eye's own place, half way, beside it; not on it, not behind it."""
    side = torch.linspace(-0.02, 0.02, 9)
    x, y = torch.meshgrid(side, side, indexing="ij")
    wall = SimpleNamespace(
        positions=torch.stack([x, y, torch.ones_like(x)], dim=-1).view(-1, 3), normals=torch.ones(81, 3)
    )
    points = torch.tensor([[0, 0, 0], [0, 0, 0.5], [0.04, 0, 1], [0, 0, 1], [0, 0, 1.5], [0, 0, 0.985], [0, 0, 0.995]])
    seen = registration._View(wall, torch.zeros(3, dtype=torch.float64)).looked_through(points.double(), 0.01)
    assert seen.tolist() == [True, True, True, False, False, True, False]
    assert not registration._View(wall, None).looked_through(points.double(), 0.01).any()


def test_the_best_candidates_are_refined_however_many_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """The true motion is the last of eight, five of which are refined: by no step here, so the others stay wrong."""
    a, wrong = bracket(), torch.eye(4, dtype=torch.float64).repeat(8, 1, 1)
    wrong[:7, 0, 3] = 0.01 * torch.arange(1, 8)
    monkeypatch.setattr(registration, "matched_motions", lambda *views: wrong)
    monkeypatch.setattr(registration, "agreed", lambda T, middle: (T, torch.arange(8, 0, -1)))
    found = register(a, a, lambda positions, normals: None, steps=0)
    assert torch.equal(found.T_a_b, torch.eye(4).double()) and (found.overlap, found.agreeing) == (1, 1)
