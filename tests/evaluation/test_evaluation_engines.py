"""Two engines on the same grasps: what both hold, agreement, disagreements; by hand."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
import torch
import trimesh
from asymmetric import GRIPPERS
from PIL import Image
from rich.console import Console

from spgf_torch.evaluation.engines import Compared, engine_results, engines_csv
from spgf_torch.evaluation.tables import engines_lines, engines_table
from spgf_torch.experiment.config import EvaluateConfig
from spgf_torch.experiment.describe import Grasps
from spgf_torch.experiment.execution import NOT_RUN, Executed
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.reporting.figures.disagreements import disagreements_picture, shown_disagreements
from spgf_torch.reporting.pages.engines_page import engines_page
from spgf_torch.simulation.table import OUTCOMES

CONFIG = EvaluateConfig(N=3, bootstrap=100, seed=0)


def codes(*words: str) -> torch.Tensor:
    return torch.tensor([OUTCOMES.index(word) if word else NOT_RUN for word in words])


def block(name: str, category: str) -> GraspObject:
    mesh = trimesh.creation.box((0.05, 0.06, 0.08))
    return GraspObject(name, category, mesh, (mesh.vertices,), 0.2, mesh.center_mass, mesh.moment_inertia)


OBJECTS = [block("one_box", "boxes"), block("egg", "curved")]


@pytest.fixture
def grasps() -> list[Grasps]:
    """NPG 0, 1, 2 and WPG 3, 4, 5 of each object, grasp k 10 mm further along x."""
    T = torch.eye(4).repeat(6, 1, 1)
    T[:, 0, 3] = 0.01 * torch.arange(6)
    return [Grasps(T, torch.tensor([0, 0, 0, 1, 1, 1])) for _ in OBJECTS]


@pytest.fixture
def compared(grasps: list[Grasps]) -> list[Compared]:
    """Grasp 1 of the box was not executed. Of the box the best are 4, 2, 0, random 5 and 0; of the egg 3, random 3."""
    best = {"NPG": torch.tensor([2, 0]), "WPG": torch.tensor([4]), "CG": torch.tensor([4, 2, 0])}
    random = {"NPG": torch.tensor([0]), "WPG": torch.tensor([5])}
    first = codes("success", "", "success", "missed", "success", "collision")
    second = codes("rotated", "", "success", "dropped", "success", "collision")
    box = {"sapien": Executed(best, first, random), "mujoco": Executed(best, second, random)}
    best = {"NPG": torch.tensor([], dtype=torch.int64), "WPG": torch.tensor([3]), "CG": torch.tensor([3])}
    random = {"NPG": torch.tensor([], dtype=torch.int64), "WPG": torch.tensor([3])}
    egg = {
        engine: Executed(best, codes("", "", "", word, "", ""), random)
        for engine, word in (("sapien", "slipped"), ("mujoco", "success"))
    }
    return [Compared.of(*row) for row in zip(OBJECTS, grasps, (box, egg), strict=True)]


def test_what_both_hold_by_hand(compared: list[Compared]) -> None:
    """Box: SAPIEN 3 of 3, MuJoCo and both 2 of 3. Egg: 0, 1 and 0 of its one. Two of three grasps are missing there."""
    found = engine_results(compared, CONFIG)
    rates = {name: found[name]["success_rate"]["all"]["CG"] for name in ("sapien", "mujoco", "both")}
    assert rates == pytest.approx({"sapien": 1 / 2, "mujoco": (2 / 3 + 1) / 2, "both": 1 / 3})
    top = {name: found[name]["top_N"] for name in rates}
    assert top == pytest.approx({"sapien": 1 / 2, "mujoco": (2 / 3 + 1 / 3) / 2, "both": 1 / 3})
    assert found["both"]["success_rate"]["boxes"]["NPG"] == 1 / 2
    assert [row["disagree"] for row in found["per_object"]] == [1, 1] and found["per_object"][0]["free"] == 4


def test_agreement_is_over_objects_and_leaves_collisions_out(compared: list[Compared]) -> None:
    """Free: 3 of the box's 4, none of the egg's 1; the best: 2 of 3 and 0 of 1. Failures of two kinds agree."""
    found = engine_results(compared, CONFIG)["agreement"]
    assert found["free"]["grasps"] == 5 and found["free"]["share"] == pytest.approx((3 / 4 + 0) / 2)
    assert found["best"]["grasps"] == 4 and found["best"]["share"] == pytest.approx((2 / 3 + 0) / 2)
    low, high = found["free"]["interval95"]
    assert low <= found["free"]["share"] <= high


def test_without_a_free_grasp_there_is_no_agreement(grasps: list[Grasps]) -> None:
    none = {"NPG": torch.tensor([0]), "WPG": torch.tensor([3]), "CG": torch.tensor([0])}
    random = {"NPG": torch.tensor([0]), "WPG": torch.tensor([3])}
    ran = Executed(none, codes("collision", "", "", "collision", "", ""), random)
    found = engine_results([Compared.of(OBJECTS[0], grasps[0], {"sapien": ran, "mujoco": ran})], CONFIG)
    assert found["agreement"]["free"] == {"grasps": 0, "share": None, "interval95": None}
    assert engines_lines(found)[-1] == "disagreements, SAPIEN / MuJoCo: none"


def test_outcomes_are_counted_by_pair(compared: list[Compared]) -> None:
    found = engine_results(compared, CONFIG)["outcomes"]
    assert found[0] == {"sapien": "success", "mujoco": "success", "grasps": 2}
    assert {"sapien": "missed", "mujoco": "dropped", "grasps": 1} in found and sum(r["grasps"] for r in found) == 6
    told = engines_lines(engine_results(compared, CONFIG))
    assert "of 4, the best grasps" in told[0] and "of 5, all grasps" in told[1]
    assert told[2] == "disagreements, SAPIEN / MuJoCo: 1 success / rotated, 1 slipped / success"


def test_the_table_shows_each_object(compared: list[Compared]) -> None:
    console = Console(file=io.StringIO(), width=100)
    console.print(engines_table(engine_results(compared, CONFIG), 3))
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    (row,) = [line for line in lines if "one_box" in line]
    assert row.replace("│", " ").split() == ["one_box", "100.0", "66.7", "66.7", "4", "1"]


def test_every_executed_grasp_is_a_row(compared: list[Compared]) -> None:
    rows = list(csv.DictReader(io.StringIO(engines_csv(compared, ("NPG", "WPG")))))
    assert [(row["object"], row["grasp"]) for row in rows] == [*(("one_box", k) for k in "02345"), ("egg", "3")]
    first = rows[0]
    assert (first["rank"], first["rank_of_type"], first["random"], first["agree"]) == ("3", "2", "1", "0")
    assert (first["sapien"], first["mujoco"], rows[3]["x"]) == ("success", "rotated", "0.040000")
    assert (rows[2]["rank"], rows[2]["rank_of_type"], rows[2]["agree"]) == ("", "", "1")


def test_disagreements_are_shown_with_the_hand_on_the_object(compared: list[Compared]) -> None:
    """The egg's first-ranked and the box's third: both are the first of their object's, in the order of objects."""
    shown = shown_disagreements(OBJECTS, compared, GRIPPERS)
    assert [(its.name, its.grasp) for its in shown] == [("one box", "NPG, rank 3"), ("egg", "WPG, rank 1")]
    assert [its.holds for its in shown] == ["sapien", "mujoco"]
    assert shown[1].ends == "SAPIEN: slipped, MuJoCo: success"
    parts = np.concatenate([shape.vertices for shape in GRIPPERS["WPG"].shapes])
    np.testing.assert_allclose(shown[1].hand.bounds[1], parts.max(axis=0) + np.array([0.03, 0, 0]), atol=1e-7)
    assert shown[0].view == (90.0, 0.0)  # along y of the TCP
    with Image.open(io.BytesIO(disagreements_picture(shown))) as picture:
        colours = {tuple(pixel) for pixel in np.asarray(picture.resize((300, 180))).reshape(-1, 3).tolist()}
    assert any(b > r + 60 for r, _, b in colours) and any(r > b + 100 for r, _, b in colours)  # blue, and vermilion
    page = engines_page(engine_results(compared, CONFIG), shown, ["a < b"], 3)
    assert "egg, WPG, rank 1: SAPIEN: slipped, MuJoCo: success" in page and "a &lt; b" in page
    assert "held only in MuJoCo" in page and engines_page(engine_results(compared, CONFIG), [], [], 3).count("None.")
