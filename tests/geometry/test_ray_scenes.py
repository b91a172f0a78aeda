"""A mesh's scene of rays goes when it is told to, and comes back with the next ray."""

import weakref

import trimesh

from spgf_torch.geometry.ray_scenes import forget_scene


def test_a_forgotten_scene_is_gone_at_once_and_made_anew() -> None:
    """From above on a box of 1 x 2 x 3: the same face twice, by two scenes."""
    mesh = trimesh.creation.box((1.0, 2.0, 3.0))
    first = mesh.ray.intersects_first([[0.1, 0.2, 5.0]], [[0.0, 0.0, -1.0]])
    scene = weakref.ref(mesh.ray)
    forget_scene(mesh)
    assert scene() is None
    assert mesh.ray.intersects_first([[0.1, 0.2, 5.0]], [[0.0, 0.0, -1.0]]) == first and first[0] >= 0
