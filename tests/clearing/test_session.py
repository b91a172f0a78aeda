"""Which scenes there are, and the pictures of a run."""

from dataclasses import replace

import pytest
from clearing_cases import OBJECTS, clip, config, scene

from spgf_torch.clearing import session
from spgf_torch.clearing.learned import Learned
from spgf_torch.clearing.outcomes import clutter_results
from spgf_torch.clearing.scene_files import SceneFiles
from spgf_torch.errors import InputError
from spgf_torch.files.reading import yaml_values
from spgf_torch.progress import ProgressReporter
from spgf_torch.simulation.worker_process import OVERDUE, WorkerDiedError


def test_scenes_follow_from_their_seeds_and_take_their_folds_in_turn(monkeypatch):
    pools = [(2, [OBJECTS[0]]), (4, [OBJECTS[1], OBJECTS[2]])]
    monkeypatch.setattr(Learned, "pools", lambda self, objects: pools)
    learned = Learned(None, None, True)
    tasks = session.scene_tasks(config(scenes=3, seed=11, film=1), learned, OBJECTS)
    assert [(task.number, task.seed, task.fold, task.filmed) for task in tasks] == [
        (0, 11, 4, False),
        (1, 12, 2, True),
        (2, 13, 4, False),
    ]
    later = session.scene_tasks(config(scenes=1, seed=13), learned, OBJECTS)[0]
    assert (later.seed, later.fold, later.objects) == (13, 4, (OBJECTS[1], OBJECTS[2]))


def test_the_filmed_scene_becomes_the_film_and_the_page_lists_all(tmp_path, monkeypatch):
    drawn = {}
    monkeypatch.setattr(session, "write_film", lambda path, each, hand: drawn.update(film=(path.name, each.name)))
    page = lambda path, summary, rounds, hand, film: drawn.update(page=(path.name, summary, rounds, film))  # noqa: E731
    monkeypatch.setattr(session, "write_clutter_page", page)
    scenes = [scene(0, [True]), scene(1, [False, True], causes=["empty"])]
    attempts = [replace(each, clip=clip()) for each in scenes[1].round.attempts]
    scenes[1] = replace(scenes[1], round=replace(scenes[1].round, attempts=attempts))
    results = clutter_results(scenes, config())
    assert session.write_pictures(scenes, results, [], None, tmp_path) == ["index.html", "film.gif"]
    assert drawn["film"] == ("film.gif", "packed 1") and drawn["page"][3] == tmp_path / "film.gif"
    summary = drawn["page"][1]
    assert summary.methods[0].success.value == results["gsr"] and summary.methods[0].causes == {"empty": 1}
    assert [each.name for each in drawn["page"][2]] == ["packed 0", "packed 1"]
    assert "1 empty" in " ".join(summary.lines)
    monkeypatch.setattr(session, "installed", lambda package: False)
    assert session.write_pictures(scenes[:1], results, [], None, tmp_path) == []


@pytest.fixture
def files(tmp_path):
    found = SceneFiles(tmp_path, "settings", {obj.name: obj for obj in OBJECTS})
    with found.open():
        yield found


def ending(monkeypatch, *ends):
    """In the place of the processes: what they yield, task by task; an exception is raised."""

    def cleared_scenes(tasks, config):
        for task, end in zip(tasks, ends, strict=True):
            if isinstance(end, KeyboardInterrupt):
                raise end
            yield task, end

    monkeypatch.setattr(session, "cleared_scenes", cleared_scenes)
    return session.scene_tasks(config(scenes=3), Learned(None, None, False), OBJECTS)


def test_a_scene_that_does_not_end_is_told_and_the_others_are_kept(files, monkeypatch):
    tasks = ending(monkeypatch, scene(0, [True]), WorkerDiedError(OVERDUE), scene(2, [True, True]))
    scenes, died = session.cleared(tasks, files, config(), ProgressReporter())
    assert [each.number for each in scenes] == [0, 2] and died == ["scene 1: did not end in time"]
    ending(monkeypatch, scene(1, [True]))  # alone: the others are read
    scenes, died = session.cleared(tasks, files, config(), ProgressReporter())
    assert [each.round.cleared for each in scenes] == [1, 1, 2] and not died


def test_an_interrupted_run_says_what_is_kept(files, monkeypatch, capsys):
    tasks = ending(monkeypatch, scene(0, [True]), KeyboardInterrupt(), None)
    with pytest.raises(KeyboardInterrupt):
        session.cleared(tasks, files, config(), ProgressReporter())
    assert f"1 of 3 scenes are kept: the same call with out={files.folder} goes on" in capsys.readouterr().err
    assert files.read(0) is not None and files.read(1) is None


def test_kept_scenes_of_other_settings_are_refused_by_their_key_and_stay_as_they_are(files, monkeypatch):
    """A camera more than the kept scene had; more scenes are no other settings. A new version is named by the file."""
    tasks = ending(monkeypatch, scene(0, [True]), scene(1, [True]), scene(2, [True]))
    session.cleared(tasks, files, config(views=2), ProgressReporter())
    before = {path: path.read_bytes() for path in [*sorted(files.folder.glob("*/*.*")), files.folder / "config.yaml"]}
    assert yaml_values(files.folder / "config.yaml", "settings", sealed=True)["views"] == 2
    other = replace(files, made_with="others")
    with pytest.raises(InputError, match=f"^views: expected 2, as the scenes kept in {files.folder} have; got 3$"):
        session.cleared(tasks, other, config(views=3, scenes=9), ProgressReporter())
    with pytest.raises(InputError, match=r"^attempt\.lift: expected 0\.15, .* got 0\.2$"):
        session.cleared(tasks, other, config(views=2, **{"attempt.lift": 0.2}), ProgressReporter())
    with pytest.raises(InputError, match=r"00000\.json: expected a scene of these settings and versions"):
        session.cleared(tasks, other, config(views=2, scenes=9), ProgressReporter())
    assert {path: path.read_bytes() for path in before} == before


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"film": 3}, "film: expected a scene from 0 to 2, or null; got 3"),
        ({"arrangement.scale": [2, 1]}, "arrangement.scale: expected two numbers above 0, the smaller first"),
        ({"arrangement.workspace": 0.05, "arrangement.kind": "pile"}, "objects: expected some that fit a workspace of"),
    ],
)
def test_scenes_that_cannot_be_are_told_before_they_are_begun(changes, told):
    with pytest.raises(InputError, match=f"^{told}"):
        session.scene_tasks(config(scenes=3, **changes), Learned(None, None, False), OBJECTS)
