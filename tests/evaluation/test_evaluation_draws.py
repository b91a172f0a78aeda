"""The best grasps in several draws, and those that failed: shares and rows by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
import trimesh
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from rich.console import Console
from trial_objects import box, can, from_above

from spgf_torch.errors import InputError
from spgf_torch.evaluate import run as evaluate
from spgf_torch.evaluation.draws import draw_results
from spgf_torch.evaluation.endings import Failed, failed_grasps
from spgf_torch.evaluation.tables import draws_table
from spgf_torch.experiment.config import EvaluateConfig
from spgf_torch.experiment.describe import Grasps
from spgf_torch.experiment.execution import Executed, execute_draws
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.paths import root
from spgf_torch.progress import ProgressReporter
from spgf_torch.reporting.pages.failures_page import failures_page
from spgf_torch.settings import typed
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.execute import Trials, codes
from spgf_torch.simulation.label import Label
from spgf_torch.simulation.robot import RobotTrials

CONFIG = EvaluateConfig(N=2, bootstrap=200, seed=0)
HELD, SHAKEN, TURNED = "success/held/none/9/", "dropped/shake/none/0/left_tip", "rotated/turn/none/3.25/"
BEST = {"NPG": torch.tensor([0, 2]), "WPG": torch.tensor([1]), "CG": torch.tensor([2, 1])}
NONE = {name: torch.tensor([], dtype=torch.int64) for name in BEST}
OBJECTS = [replace(box((0.04, 0.06, 0.1)), name="a", category="boxes"), replace(can(), name="b", category="curved")]


def ran(*words: str, best: dict[str, torch.Tensor] = BEST) -> Executed:
    return Executed(best, codes(words), {}, dict(enumerate(words)))


# Of three draws on object a, and of one grasp of a type without another on b, which holds always.
ONE = {"NPG": torch.tensor([0]), "WPG": NONE["WPG"], "CG": torch.tensor([0])}
BY_DRAW = [
    [ran(HELD, HELD, SHAKEN), ran(HELD, best=ONE)],
    [ran(SHAKEN, HELD, HELD), ran(HELD, best=ONE)],
    [ran(SHAKEN, TURNED, HELD), ran(HELD, best=ONE)],
]


def results() -> dict[str, Any]:
    return draw_results(OBJECTS, BY_DRAW, CONFIG)


def test_shares_by_hand() -> None:
    """Object a: NPG (1 + 1 + 1) / 6, WPG 2 / 3, CG (1 + 2 + 1) / 6; of its two CG grasps neither holds always."""
    found = results()
    first, second = found["per_object"]
    assert (first["object"], first["class"]) == ("a", "boxes") and found["draws"] == 3
    assert [first[name] for name in ("NPG", "WPG", "CG", "all_draws")] == pytest.approx([1 / 2, 2 / 3, 2 / 3, 0])
    assert [second[name] for name in ("NPG", "WPG", "CG", "all_draws")] == [1, 0, 1, 1]
    assert found["success_rate"]["all"]["CG"] == pytest.approx(5 / 6) and found["all_draws"] == 0.5
    assert found["success_rate"]["boxes"]["CG"] == pytest.approx(2 / 3)
    assert found["by_draw"] == pytest.approx([0.75, 1, 0.75])
    assert found["top1"] == pytest.approx((2 / 3 + 1) / 2)  # grasp 2 fails in the first draw
    assert found["top_N"] == pytest.approx((4 / 6 + 3 / 6) / 2)  # b has one grasp of two
    assert found["failures"] == {"dropped (shake, without left_tip)": 1, "rotated (turn)": 1}
    low, high = found["interval95"]["all"]["CG"]
    assert low == high == pytest.approx(5 / 6)  # one object a class: it is drawn again each time


def test_the_table_shows_them() -> None:
    console = Console(width=100, record=True)
    console.print(draws_table(results(), 2))
    shown = console.export_text()
    assert "2 highest-ranked grasps in 3 draws" in shown and "CG in all draws" in shown
    (row,) = [line for line in shown.splitlines() if " a " in line]
    assert [word for word in row.split() if word[0].isdigit()] == ["50.0", "66.7", "66.7", "0.0"]


def test_without_any_grasp_nothing_holds() -> None:
    nothing = [[ran(HELD, best=NONE), ran(HELD, best=NONE)]] * 2
    found = draw_results(OBJECTS, nothing, CONFIG)
    assert found["top1"] == found["top_N"] == found["all_draws"] == found["success_rate"]["all"]["CG"] == 0
    assert found["by_draw"] == [0, 0] and found["failures"] == {}


def test_failed_grasps_by_draw_and_rank() -> None:
    """CG ranks grasp 2 before 1."""
    grasps = [Grasps(torch.eye(4).expand(n, 4, 4), torch.tensor(types)) for n, types in ((3, [0, 1, 0]), (1, [0]))]
    failed = failed_grasps(OBJECTS, grasps, BY_DRAW, ("NPG", "WPG"))
    assert failed == [
        Failed("a", 0, 1, "NPG", Label.of(SHAKEN)),
        Failed("a", 2, 2, "WPG", Label.of(TURNED)),
    ]


def test_the_page_says_why() -> None:
    """Phase, cause, force and fingers of each; of an episode without causes the outcome alone."""
    pytest.importorskip("plotly")
    label = Label("missed", "lift", "one_side", 1.26, "left_tip+left_pad")
    page = failures_page([Failed("<a>", 2, 7, "WPG", label), Failed("b", 0, 1, "NPG", Label("slipped"))], 40, [])
    rows = [line for line in page.splitlines() if line.startswith("<tr><td")]
    assert "2 of 40 trials" in page and '<section id="where">' not in page
    cells = [row.replace('<td class="words">', "<td>").replace("</tr>", "").split("<td>")[1:] for row in rows]
    each = [[cell.removesuffix("</td>") for cell in row] for row in cells if len(row) > 2]
    assert each == [
        ["&lt;a&gt;", "2", "7", "WPG", "missed", "lift", "one side", "1.3", "left_tip, left_pad"],
        ["b", "0", "1", "NPG", "slipped", "", "", "", ""],
    ]


def composed(command: str, *overrides: str) -> Any:
    with initialize_config_dir(str(root() / "conf"), version_base="1.3"):
        return OmegaConf.to_container(compose(command, overrides=list(overrides)), resolve=True)


def test_draws_are_those_after_the_episodes_own() -> None:
    """The best two of three grasps, in draws 2 and 3 as if each was the episode's; no random sample."""
    episode = typed(EpisodeConfig, composed("simulate", "episode=robot_fast", "episode.robot.draw=1")["episode"])
    trials = Trials(load_hand(typed(HandConfig, composed("hand", "hand=panda")["hand"])), episode)
    heights = (0.09, 0.3, 0.085)
    T = torch.stack([torch.from_numpy(from_above(height)) for height in heights])
    given = [box((0.03, 0.06, 0.1))], [Grasps(T, torch.tensor([1, 1, 1]))], [torch.tensor([0.9, 0.1, 0.5])]
    config = replace(CONFIG, draws=3, engine="sapien", workers=1, random_trials=3)
    second, third = execute_draws(*given, trials, config, ProgressReporter())
    assert episode.robot is not None
    for number, (ran,) in ((2, second), (3, third)):
        drawn = replace(episode, robot=replace(episode.robot, draw=number))
        robot = RobotTrials(given[0][0], trials.hand, drawn, "WPG")
        assert ran.best["CG"].tolist() == [0, 2] and set(ran.ended) == {0, 2}
        assert [ran.ended[index] for index in (0, 2)] == [robot.run(T[k].numpy()).word for k in (0, 2)]
    assert second[0].ended != third[0].ended


def test_the_command_reports_draws(tmp_path: Path) -> None:
    """The first draw is the one that is executed without others."""
    block = trimesh.creation.box((0.05, 0.06, 0.08)).subdivide().subdivide()
    (tmp_path / "meshes").mkdir()
    block.export(tmp_path / "meshes/block.ply")
    words = [
        f"objects={tmp_path}/meshes",
        "category=boxes",
        "hand=panda",
        "model=panda",
        "sensing.cameras=1",
    ]
    words += ["N=3", "random_trials=1", "bootstrap=100", "workers=1", "episode=robot_fast", "table=true", "draws=2"]
    (tmp_path / "run").mkdir()
    evaluate(typed(EvaluateConfig, composed("evaluate", *words)), tmp_path / "run")
    found = json.loads((tmp_path / "run/results.json").read_text())
    its = found["robustness"]
    assert its["draws"] == 2 and [row["object"] for row in its["per_object"]] == ["block"]
    assert its["by_draw"][0] == pytest.approx(found["per_object"][0]["CG"])
    failed = sum(its["failures"].values())
    assert failed == round(6 * (1 - its["success_rate"]["all"]["CG"]))
    assert (tmp_path / "run/failures.html").is_file() == bool(failed)


def test_draws_of_an_episode_that_draws_nothing_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^draws: expected 1 .*, got 2; episode=robot does$"):
        evaluate(typed(EvaluateConfig, composed("evaluate", "objects=x", "draws=2")), tmp_path)
