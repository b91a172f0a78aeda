"""Finished scenes on disk: what is written comes back; damage costs time, other settings are refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from clearing_cases import OBJECTS, clip, scene

from spgf_torch.clearing.scene_files import SceneFiles
from spgf_torch.errors import InputError
from spgf_torch.simulation.arrangements import scaled

LIBRARY = {obj.name: obj for obj in OBJECTS}


@pytest.fixture
def files(tmp_path):
    found = SceneFiles(tmp_path / "run", "these settings", LIBRARY)
    with found.open():
        yield found


def rich_scene():
    """With a film, a probability that is unknown, a last view, and a smaller object."""
    its = scene(12, [False, True], causes=["dropped"], ended="no grasp")
    first, second = its.round.attempts
    tried = [replace(first, probability=math.nan, clip=clip()), second]
    objects = [scaled(OBJECTS[0], 0.8), *its.round.objects[1:]]
    return replace(its, fold=3, round=replace(its.round, attempts=tried, objects=objects, last=first.view))


def test_a_scene_comes_back_as_it_was(files):
    files.write(before := rich_scene())
    after = files.read(12)
    assert (after.number, after.seed, after.fold, after.measured) == (12, 12, 3, before.measured)
    assert (after.round.name, after.round.ended) == ("packed 12", "no grasp")
    for old, new in zip(before.round.attempts, after.round.attempts, strict=True):
        assert (new.cause, new.taken, new.touched, new.success) == (old.cause, old.taken, old.touched, old.success)
        assert new.view.present == old.view.present and new.grasp_type == old.grasp_type
        np.testing.assert_array_equal(new.view.points, old.view.points)
        np.testing.assert_array_equal(new.T_world_tcp, old.T_world_tcp)
    assert math.isnan(after.round.attempts[0].probability) and after.round.attempts[1].probability == 0.5
    film = after.round.attempts[0].clip
    assert list(film.links) == ["palm"] and film.object_poses.shape == (2, 2, 4, 4) and film.times[1] == 0.5
    assert after.round.attempts[1].clip is None and after.round.last.present == (0, 1, 2)
    assert after.round.objects[0].mesh.extents == pytest.approx([0.024, 0.032, 0.096])
    assert after.round.objects[1] is OBJECTS[1]


def test_what_is_damaged_or_missing_is_cleared_again(files):
    assert files.read(12) is None
    files.write(rich_scene())
    for name in ("00012.npz", "00012.json"):
        path = files.folder / "scenes" / name
        whole = path.read_bytes()
        path.write_bytes(whole[:-9] + b"x" + whole[-8:])
        assert files.read(12) is None
        path.write_bytes(whole)
    (files.folder / "scenes/00012.npz").unlink()
    assert files.read(12) is None


def test_scenes_of_other_settings_are_refused(files):
    files.write(rich_scene())
    with pytest.raises(InputError, match=r"00012\.json: expected a scene of these settings and versions"):
        replace(files, made_with="others").read(12)


def test_two_calls_do_not_share_a_folder(files):
    with pytest.raises(InputError, match=r"^out: expected a folder that no other clutter writes to"), files.open():
        pass


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").touch()
    files = SceneFiles(tmp_path / "file", "", LIBRARY)
    with pytest.raises(InputError, match=r"^out: expected a folder that can be made"), files.open():
        pass
