"""What a page shows beside grasps, gathered from a scene, a hand and prototypes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from asymmetric import asymmetric

from spgf_torch.drawing.grasp_beside import beside_of, model_words
from spgf_torch.drawing.grasp_scene import Told
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.scene.scene import Scene
from spgf_torch.sensing.cameras import Camera, look_at
from spgf_torch.sensing.unseen import DepthView
from spgf_torch.settings import settings


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A ball of 40 mm, seen from (0.3, 0, 0.4)."""
    outwards = np.random.default_rng(0).normal(size=(3000, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    return Scene.from_points(0.04 * outwards, normals=outwards, viewpoints=[0.3, 0.0, 0.4], table=[0.0, 0.0, 1.0, 0.04])


def test_a_view_tells_how_far_its_image_reaches(scene: Scene) -> None:
    """4 x 2 pixels, focal length 2, principal point (1.5, 0.5): the borders lie 1 to the sides, 0.5 above and below."""
    K = np.array([[2.0, 0, 1.5], [0, 2, 0.5], [0, 0, 1]])
    camera = Camera(K, look_at(np.array([0.3, 0.0, 0.4]), np.zeros(3)), 4, 2)
    seen = replace(scene, views=(DepthView.of(np.ones((2, 4)), camera),))
    ((place, axes, reach),) = beside_of(seen, [], None).cameras
    np.testing.assert_allclose(place, [0.3, 0, 0.4], atol=1e-6)
    np.testing.assert_allclose(axes[:, 2], [-0.6, 0, -0.8], atol=1e-6)
    np.testing.assert_allclose(reach, [[-1, -0.5], [1, 0.5]], atol=1e-6)


def test_without_images_the_places_are_known(scene: Scene) -> None:
    ((place, axes, reach),) = beside_of(replace(scene, views=None), [], None).cameras
    assert place.tolist() == [0.3, 0.0, 0.4] and axes is None and reach is None
    assert beside_of(replace(scene, views=None, viewpoints=None), [], None).cameras == ()


def test_hands_close_and_prototypes_have_pictures(scene: Scene) -> None:
    """Of the types and the prototypes that there are grasps and votes of, and of no others."""
    rings = np.full((9, 2, 8, 2), 45.0)
    beside = beside_of(
        scene, [asymmetric("WPG")], load_hand(settings(HandConfig)), rings_deg=rings, told=Told(lines=("a",))
    )
    assert sorted(beside.pictures) == [3, 7] and beside.pictures[3].startswith("<svg")
    assert list(beside.closing) == ["WPG"] and beside.closing["WPG"].shape[2:] == (4, 4)
    np.testing.assert_allclose(
        beside.closing["WPG"][0], np.broadcast_to(np.eye(4), beside.closing["WPG"][0].shape), atol=1e-6
    )
    assert np.abs(beside.closing["WPG"][-1] - np.eye(4)).max() > 0.01
    assert beside.told.lines == ("a",) and beside.weighed == ()
    assert beside_of(scene, [], None).told.notes == scene.notes


def test_a_model_is_called_by_folder_and_digest(tmp_path: Path) -> None:
    folder = tmp_path / "panda"
    folder.mkdir()
    assert model_words(folder) == "panda"
    (folder / "judge.json").write_text(json.dumps({"tensors_sha256": "c0036bf3" + 56 * "0"}))
    assert model_words(folder) == "panda (c0036bf3)"
