"""The report of a made-up hand of three grasp types: its own names, shapes and number, and nothing of the paper's."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from report_runs import ROOT, write_run

from spgf_torch.errors import InputError
from spgf_torch.hands.config import HandConfig, JointConfig, PreshapeConfig, TCPConfig
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.library import load_objects
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.reporting.data.predictions import predictions_of
from spgf_torch.reporting.data.runs import Notes, load_runs, read_per_object
from spgf_torch.reporting.data.sweep import find_sweep
from spgf_torch.reporting.pages.context import Context, choose
from spgf_torch.reporting.pages.grasp_parts import precision_part, reliability_part, worst_part
from spgf_torch.reporting.pages.model_parts import grasps_part
from spgf_torch.reporting.pages.pictured import Pictured, pictured
from spgf_torch.reporting.pages.rate_parts import headline, over_k, table_part
from spgf_torch.reporting.pages.table1 import table1
from spgf_torch.settings import settings

KINDS = ("hook", "pinch", "sphere")
SIDES = ("finger_1", "finger_2", "thumb")


def hand() -> HandConfig:
    """The SDH-2's links with three fingers: two jaws, and all three around a ball."""
    known = settings(HandConfig)
    narrow = asdict(known.preshapes["NPG"])
    tips, drive = {f"{side}_distal_joint": 30.0 for side in SIDES}, JointConfig(effort=2.0, stiffness=40.0, damping=1.5)
    around = PreshapeConfig(
        hold={"finger_1_knuckle_joint": 60.0, "finger_2_knuckle_joint": 60.0},
        open={**{f"{side}_proximal_joint": -30.0 for side in SIDES}, **tips},
        close={f"{side}_proximal_joint": 1.0 for side in SIDES},
        parallel={f"{side}_distal_joint": f"{side}_proximal_joint" for side in SIDES},
        oppose=[["thumb"], ["first"], ["second"]],
        pads={name: [0.0148, 0, 0.040] for name in ("first", "second", "thumb")},
        tcp=TCPConfig([0, 0, 0.2059], [1, 0, 0]),
        symmetry=3,
    )
    jaws = {"oppose": [["first"], ["second"]], "pads": {name: [0.0148, 0, 0.040] for name in ("first", "second")}}
    two = {
        name: PreshapeConfig(**{**narrow, **jaws, "opening": wide}) for name, wide in (("hook", 0.06), ("pinch", 0.03))
    }
    known.name, known.preshapes = "claw", {**two, "sphere": around}
    known.fingers = {"first": ["finger_1_tip"], "second": ["finger_2_tip"], "thumb": ["thumb_tip"]}
    known.joints |= {f"thumb_{part}_joint": drive for part in ("proximal", "distal")}
    return known


@pytest.fixture(scope="module")
def context(tmp_path_factory: pytest.TempPathFactory) -> Context:
    folder = tmp_path_factory.mktemp("runs")
    write_run(folder / "2026-01-01_00-00-00_a", K=10, skill=0.5, hand=asdict(hand()))
    config = ReportConfig(str(folder), "nested", ["paper"], None, None, None, 1, 1, 4, 5, 100, 0)
    notes = Notes()
    return choose(config, find_sweep(load_runs(config.runs, notes, pictured=True), 100, 0, notes), notes)


@pytest.fixture(scope="module")
def library() -> dict[str, GraspObject]:
    return {
        obj.name: obj for obj in load_objects(ROOT / "data/objects") if obj.name in ("mug_coffee", "box_tea", "egg")
    }


@pytest.fixture(scope="module")
def shown(context: Context) -> Pictured:
    return pictured(context, {})


def test_types_are_the_hands_in_the_order_of_their_names(context: Context) -> None:
    assert context.shown.types == (*KINDS, "CG") and not context.shown.of_papers_hand
    assert list(read_per_object(context.shown)[0].rates["nested"]) == [*KINDS, "CG"]


def test_rates_of_every_type_and_none_of_the_papers(context: Context) -> None:
    found = table1(context.sweep.rows, [], context.rankings, context.row)
    parts = [headline(context), table_part(context, found), over_k(context)]
    body = "".join(part.section.body for part in parts)
    assert "a random candidate, hook / pinch / sphere<" in body and "CG less the best of hook, pinch, sphere" in body
    assert "Grasp types of the hand: hook, pinch, sphere; CG is all of them in one ranking." in body
    for word in ("NPG", "WPG", "RobWorkSim", "Grey: the paper", "Grey rows", "; the paper's: ", "the paper, K"):
        assert word not in body, word
    heads = parts[1].files["table1.md"].decode().splitlines()[2].split(" | ")
    assert heads[1:5] == ["containers hook", "containers pinch", "containers sphere", "containers CG"]


def test_single_grasps_of_every_type(context: Context, library: dict[str, GraspObject]) -> None:
    objects = predictions_of(context.shown, context.ranking)
    assert {name for o in objects for name in np.array(o.grasp_types)[o.grasp_type]} == {*KINDS}
    assert "sphere" in reliability_part(context, objects).section.body
    assert precision_part(context, objects).files
    worst = worst_part(context, objects, library, context.grippers)
    assert "Lines are the open hand" in worst.section.body and worst.files["worst_objects.png"]


def test_what_was_learned_is_drawn_with_the_hands_own_shapes(context: Context, shown: Pictured) -> None:
    """Of one prototype: the others take as long again."""
    part = grasps_part(context, replace(shown, looks=shown.looks[:1]), "sphere")
    assert part.section.title == "Learned: sphere" and list(part.files) == ["learned_sphere.png"]
    assert "the grasp type sphere: each" in part.section.body


def test_a_run_of_another_hand_than_its_rates_is_left_out(tmp_path: Path) -> None:
    write_run(tmp_path / "2026-01-01_00-00-00_a", K=3)
    path = tmp_path / "2026-01-01_00-00-00_a/config.yaml"
    path.write_text(path.read_text().replace("    NPG:", "    narrow:"))
    notes = Notes()
    with pytest.raises(InputError, match="at least one finished run"):
        load_runs(str(tmp_path), notes)
