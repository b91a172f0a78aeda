"""Runs on the same scenes beside each other."""

import pytest
from clearing_cases import config, scene

from spgf_torch.clearing.comparison import OtherRun, beside, beside_lines
from spgf_torch.clearing.outcomes import clutter_results
from spgf_torch.errors import InputError
from spgf_torch.evaluation.files import rounded
from spgf_torch.files.digests import sealed_json

OURS = [scene(0, [True, True], objects=2), scene(1, [True, False, False], objects=3, causes=["dropped"] * 2)]
THEIRS = [scene(0, [False, True, True], objects=2, causes=["missed"]), scene(1, [False, False], causes=["table"] * 2)]


def kept(folder, scenes, **changes):
    folder.mkdir()
    results = clutter_results(scenes, config(method="antipodal")) | changes
    (folder / "results.json").write_bytes(sealed_json(rounded(results)))
    return OtherRun.read(str(folder))


def test_differences_are_paired_over_the_same_draws_of_scenes(tmp_path):
    ours = clutter_results(OURS, config())
    found = beside(ours, [kept(tmp_path / "other", THEIRS)], config())
    its = found[str(tmp_path / "other")]
    assert its["gsr_difference"] == pytest.approx(3 / 5 - 2 / 5) and its["dr_difference"] == pytest.approx(1 / 5)
    # A draw has scene 0 twice, scene 1 twice, or both: success a grasp 1 and 2/3, 1/3 and 0, 3/5 and 2/5.
    possible = [1 - 2 / 3, 1 / 3 - 0, 3 / 5 - 2 / 5]
    assert its["gsr_difference_interval95"] == pytest.approx([min(possible), max(possible)])
    # Objects: 1 and 1, 1/3 and 0, 3/5 and 2/5.
    assert its["dr_difference_interval95"] == pytest.approx([0, 1 / 3])
    (line,) = beside_lines(ours | {"beside": found})
    assert "ours minus antipodal in" in line and "GSR +20.0 (+20 to +33), DR +20.0 (+0 to +33) points" in line


def test_other_scenes_are_refused(tmp_path):
    ours = clutter_results(OURS, config())
    for name, scenes, changes in (
        ("fewer", THEIRS[:1], {}),
        ("others", [THEIRS[0], scene(1, [True], objects=2)], {}),
        ("piled", THEIRS, {"arrangement": "pile"}),
    ):
        with pytest.raises(InputError, match=r"^beside: expected a run on the same 2 scenes"):
            beside(ours, [kept(tmp_path / name, scenes, **changes)], config())


def test_older_runs_have_names_in_one_text(tmp_path):
    ours = clutter_results(OURS, config())
    rows = [{**row, "names": " ".join(row["names"])} for row in ours["per_scene"]]
    assert beside(ours, [kept(tmp_path / "older", OURS, per_scene=rows)], config())
    rows[0]["names"] = "flat tall"
    with pytest.raises(InputError, match=r"^beside: expected a run on the same 2 scenes"):
        beside(ours, [kept(tmp_path / "others", OURS, per_scene=rows)], config())


@pytest.mark.parametrize("changes", [{"seed": 1}, {"scenes": 3}, {"arrangement.kind": "pile"}])
def test_seeds_tell_other_scenes_before_anything_is_begun(changes, tmp_path):
    other = kept(tmp_path / "other", THEIRS)
    other.check(config(scenes=2))
    with pytest.raises(InputError, match=r"^beside: .*others \(packed, 2 from seed 0 on\) in "):
        other.check(config(**{"scenes": 2, **changes}))


def test_what_is_no_run_is_told_in_one_line(tmp_path):
    with pytest.raises(InputError, match=r"results\.json"):
        OtherRun.read(str(tmp_path))
    (tmp_path / "results.json").write_bytes(sealed_json({"per_scene": [{"cleared": 1}]}))
    with pytest.raises(InputError, match=r"results\.json: expected results of clutter, got something else"):
        OtherRun.read(str(tmp_path))


def test_without_attempts_there_is_no_difference_of_grasps(tmp_path):
    idle = [scene(0, [], objects=2, ended="no grasp"), scene(1, [], objects=3, ended="no grasp")]
    ours = clutter_results(idle, config())
    its = beside(ours, [kept(tmp_path / "other", THEIRS)], config())[str(tmp_path / "other")]
    assert its["gsr_difference"] is None and its["gsr_difference_interval95"] == [None, None]
    assert its["dr_difference"] == pytest.approx(-2 / 5)
    assert "GSR +nan" in beside_lines(ours | {"beside": {"x": its}})[0]
