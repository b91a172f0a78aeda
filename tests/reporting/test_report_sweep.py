"""What belongs together: the sweep over K, variants beside it, and what they differ in."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from spgf_torch.errors import InputError
from spgf_torch.reporting.data import seeds
from spgf_torch.reporting.data.runs import ObjectRow, Run
from spgf_torch.reporting.data.seeds import Repeats
from spgf_torch.reporting.data.sweep import Sweep, difference, find_sweep
from spgf_torch.reporting.pages.ablations import points
from spgf_torch.reporting.pages.context import tell_replaced


def made(stamp: str, K: int, **settings: Any) -> Run:
    values = {"K": K, "seed": 0, "features": {"layers": 2, "radius": 0.03}, "workers": 1, **settings}
    return Run(Path(stamp), stamp, values, K, 10, values["seed"], "d", {}, {}, {}, {}, {}, {}, {})


@pytest.fixture(autouse=True)
def one_object(monkeypatch: pytest.MonkeyPatch) -> None:
    """These runs are in no folder."""
    monkeypatch.setattr(seeds, "read_per_object", lambda run: [row("a", "boxes", 0.5)])


def found(*runs: Run) -> Sweep:
    return find_sweep(runs, 100, 0, print)


def stamps(row: Repeats) -> list[str]:
    return [run.stamp for run in row.runs]


def test_of_equal_groups_the_one_in_the_middle_is_the_sweep() -> None:
    """A star: three runs that each vary one setting, one of them with K = 1, too, and the usual settings older."""
    features = {"layers": 2, "radius": 0.03, "alignment": "argmax"}
    runs = [
        made("1", 20, features=features),
        made("2", 20, features={**features, "radius": 0.02}),
        made("3", 20, features={**features, "alignment": "random"}),
        made("4", 1, features={**features, "alignment": "random"}),
    ]
    sweep = found(*runs)
    assert [row.runs for row in sweep.rows] == [(runs[0],)] and len(sweep.variants) == 3


def test_runs_that_differ_in_k_alone_are_the_sweep() -> None:
    runs = [made("1", 5), made("2", 20), made("3", 20, features={"layers": 1, "radius": 0.03})]
    sweep = found(*runs)
    assert [stamps(row) for row in sweep.rows] == [["1"], ["2"]]
    (variant,) = sweep.variants
    assert stamps(variant.runs) == ["3"] and stamps(variant.reference) == ["2"]
    assert variant.varies == {"features.layers": ("1", "2")} and variant.label == "features.layers = 1 (2)"


def test_of_equal_runs_the_newest_counts() -> None:
    sweep = found(made("1", 5), made("2", 10), made("3", 5, workers=8, objects="elsewhere", cache="off"))
    assert [(row.K, stamps(row)) for row in sweep.rows] == [(5, ["3"]), (10, ["2"])] and not sweep.variants


def test_of_equal_runs_one_that_kept_the_models_of_its_folds_counts(tmp_path: Path) -> None:
    """Its rates are the same, and it has more to show."""
    (tmp_path / "fold_models").mkdir()
    (tmp_path / "fold_models/objects.json").touch()
    kept = replace(made("2", 10, fold_models=True), folder=tmp_path)
    assert [stamps(row) for row in found(made("1", 10), kept, made("3", 10)).rows] == [["2"]]


def test_runs_that_differ_in_the_seed_alone_are_one_experiment() -> None:
    """Also beside the sweep; of one seed twice the newer counts; a run that does not say `classwise` had it not."""
    runs = [made("1", 5, seed=3), made("2", 5), made("3", 10), made("4", 5, seed=3, classwise=False)]
    other = {"layers": 1, "radius": 0.03}
    sweep = found(*runs, made("5", 5, seed=1, features=other), made("6", 5, seed=0, features=other))
    assert [(row.K, stamps(row)) for row in sweep.rows] == [(5, ["2", "4"]), (10, ["3"])]
    (variant,) = sweep.variants
    assert stamps(variant.runs) == ["6", "5"] and stamps(variant.reference) == ["2", "4"]
    assert variant.varies == {"features.layers": ("1", "2")}


def test_experiments_that_differ_in_reach_and_k_alone() -> None:
    """The variant of two settings is none of them, nor is the one of another reach and other features."""
    usual, near = {"reach": 0.1}, {"reach": 0.03}
    runs = [made(f"{K}", K, affordance=usual) for K in (5, 20)]
    runs += [made("a", 1, affordance=near), made("b", 20, affordance=near)]
    runs += [made("c", 20, affordance=near, features={"layers": 1}), made("d", 20, affordance=usual, N=3)]
    curves = found(*runs).by_reach()
    assert {reach: [row.K for row in rows] for reach, rows in curves.items()} == {0.03: [1, 20], 0.1: [5, 20]}
    assert found(made("1", 5)).by_reach() == {}


def test_experiments_with_each_class_by_itself() -> None:
    sweep = found(made("1", 5), made("2", 20), made("3", 20, classwise=True), made("4", 20, classwise=True, N=3))
    assert [stamps(row) for row in sweep.classwise()] == [["3"]]


def test_a_judge_that_a_newer_run_hides_is_told() -> None:
    older, newer, told = replace(made("1", 5), by_ranking={"judge": {}}, interval95={"judge": {}}), made("2", 5), []
    tell_replaced([older, newer], found(older, newer), told.append)
    assert len(told) == 1 and "no ranking judge of K = 5: 1 has it" in told[0]
    tell_replaced([newer, older], found(newer, older), told.append)
    assert len(told) == 1


def test_of_two_groups_of_one_size_the_newest_is_the_sweep() -> None:
    sweep = found(made("1", 20), made("2", 20, N=3))
    assert stamps(sweep.rows[0]) == ["2"]
    assert sweep.variants[0].varies == {"N": ("-", "3")}


def test_of_two_groups_of_one_size_the_one_of_more_seeds_is_the_sweep() -> None:
    sweep = found(made("1", 20), made("2", 20, seed=1), made("3", 20, features={"layers": 1, "radius": 0.03}))
    assert stamps(sweep.rows[0]) == ["1", "2"]


def test_a_variant_is_compared_with_its_own_k_or_the_one_next_to_20() -> None:
    sweep = found(made("1", 5), made("2", 15), made("3", 25), made("4", 5, N=1), made("5", 10, N=2))
    references = {stamps(variant.runs)[0]: stamps(variant.reference)[0] for variant in sweep.variants}
    assert references == {"4": "1", "5": "2"}  # of 15 and 25, as near to 20, the smaller
    assert [variant.varies for variant in sweep.variants] == [{"K": ("10", "15"), "N": ("2", "-")}, {"N": ("1", "-")}]


def test_k_that_the_paper_does_not_have_is_in_the_sweep_and_an_ablation() -> None:
    sweep = found(made("1", 1), made("2", 10), made("3", 20))
    assert [row.K for row in sweep.rows] == [1, 10, 20]
    assert [(variant.label, variant.reference.K) for variant in sweep.variants] == [("K = 1 (20)", 20)]


def test_variants_are_ordered_by_number() -> None:
    runs = [
        made("1", 5),
        made("2", 20),
        *(made(f"{i + 3}", 20, trials_per_object=n) for i, n in enumerate((100, 25, 500))),
    ]
    assert [v.varies["trials_per_object"] for v in found(*runs).variants] == [
        ("25", "-"),
        ("100", "-"),
        ("500", "-"),
    ]


def row(name: str, category: str, rate: float) -> ObjectRow:
    return ObjectRow(name, category, 0, {"paper": {"NPG": rate, "WPG": 0.5, "CG": rate}})


def test_differences_are_paired_by_object_not_by_row() -> None:
    """b and a in either order; c is missing in one. a: 0.4 - 0.6, b: 0.9 - 0.5; mean of -0.2 and 0.4 = 0.1."""
    ours = [row("a", "boxes", 0.4), row("b", "curved", 0.9)]
    theirs = [row("b", "curved", 0.5), row("a", "boxes", 0.6), row("c", "boxes", 1.0)]
    change = difference({0: ours}, {0: theirs}, "paper", 200, 0)
    assert change.objects == 2
    assert change.mean["all"]["CG"] == pytest.approx(0.1) and change.mean["boxes"]["CG"] == pytest.approx(-0.2)
    assert change.interval95["boxes"]["CG"] == pytest.approx((-0.2, -0.2))  # of one object
    assert change.mean["all"]["WPG"] == 0


def test_differences_are_paired_by_seed_too() -> None:
    """Seeds 1 and 2 are shared: a 0.1 and 0.3, b -0.1 and 0.5; means 0.2 and 0.2. Unpaired, seed 7 would enter."""
    ours = {2: [row("a", "boxes", 0.7), row("b", "curved", 0.9)], 1: [row("a", "boxes", 0.3), row("b", "curved", 0.1)]}
    theirs = {n: [row("b", "curved", b), row("a", "boxes", a)] for n, a, b in ((7, 0, 0), (1, 0.2, 0.2), (2, 0.4, 0.4))}
    change = difference(ours, theirs, "paper", 1000, 0)
    assert (change.objects, change.seeds) == (2, 2)
    assert {name: rates["CG"] for name, rates in change.mean.items()} == pytest.approx(
        {"boxes": 0.2, "curved": 0.2, "all": 0.2}
    )
    assert change.interval95["curved"]["CG"] == pytest.approx((-0.1, 0.5))
    with pytest.raises(InputError, match="expected a seed"):
        difference(ours, {7: theirs[7]}, "paper", 100, 0)


def test_runs_without_a_common_object_are_refused() -> None:
    with pytest.raises(InputError, match="objects"):
        difference({0: [row("a", "boxes", 1)]}, {0: [row("b", "boxes", 1)]}, "paper", 100, 0)


@pytest.mark.parametrize(
    ("fraction", "digits", "words"), [(-0.0002, 1, "+0.0"), (-0.2, 0, "-20"), (0.0051, 1, "+0.5"), (-0.004, 0, "+0")]
)
def test_points_have_a_sign_and_no_negative_zero(fraction: float, digits: int, words: str) -> None:
    assert points(fraction, digits) == words
