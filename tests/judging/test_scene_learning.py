"""What a judge learns in scenes: what is met there, tables of trials, learning, and how judges compare."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from judges import quick_judge
from omegaconf import OmegaConf

from spgf_torch.errors import InputError
from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.judging.config import ContextConfig, JudgeConfig, TreesConfig
from spgf_torch.judging.scene_benches import SceneCheck
from spgf_torch.judging.scene_learning import SceneLessons, SceneRows, learn_scenes
from spgf_torch.judging.scene_rounds import OBJECT, SCENE
from spgf_torch.judging.scene_trials import FILE, SceneTrials, read_scene_trials, write_scene_trials
from spgf_torch.judging.scene_validation import compared, scene_lines
from spgf_torch.objects.library import load_object, load_objects
from spgf_torch.paths import find
from spgf_torch.proposing.clearance import Plane, Surroundings
from spgf_torch.proposing.config import NeighboursConfig, ProposingConfig
from spgf_torch.proposing.hypotheses import Hypotheses
from spgf_torch.proposing.judge import SCENE_NUMBERS, load_judge, save_judge
from spgf_torch.proposing.judge_features import NAMES, Seen
from spgf_torch.proposing.judge_influences import weighed
from spgf_torch.proposing.judge_proposer import JudgedProposer, ranked
from spgf_torch.sensing.cameras import surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import observe_on_table
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.arrangements import Placed
from spgf_torch.simulation.attempts import CAUSES

MADE = JudgeConfig(
    form="trees",
    bootstrap=200,
    seed=0,
    learning=settings(TreesConfig, trees=20, least=10),
    context=ContextConfig(views=[1, 4]),
)
TYPES = ("NPG", "WPG")
NEIGHBOURS = OmegaConf.to_container(OmegaConf.load(find("conf/proposing/clutter.yaml")).neighbours)


def trials(count: int = 12) -> SceneTrials:
    """Of three scenes and two clouds, chosen by both; the object judge's last of each scene failed."""
    index = torch.arange(count)
    T = torch.nn.functional.normalize(torch.rand(count, 4, generator=torch.Generator().manual_seed(1)))
    cause = torch.where((index % 4 == 3), CAUSES.index("dropped"), CAUSES.index("none"))
    by = torch.where(index % 4 < 2, SCENE, OBJECT)
    same = torch.zeros_like(index)
    said = torch.where(index % 4 == 3, 0.6, 0.8)
    return SceneTrials(
        500 + index // 4, same + 1, same, same + 3, by, index % 2, torch.rand(count, 3), T, same + 1, cause, said
    )


def test_what_is_met_on_the_way() -> None:
    """A mug between the fingers of a hand from above, a bottle beside it, and one where the hand comes along."""
    hand_config = typed(HandConfig, OmegaConf.to_container(OmegaConf.load(find("conf/hand/panda.yaml"))))
    objects = {obj.name: obj for obj in load_objects(find("data/objects"))}
    tea, bottle = objects["box_tea"], objects["bottle_water"]
    flat = np.eye(4)
    flat[2, 3] = -tea.mesh.bounds[0, 2]
    beside, above = np.eye(4), np.eye(4)
    beside[:3, 3] = [0.0, 0.2, -bottle.mesh.bounds[0, 2]]
    above[:3, 3] = [0.0, 0.0, 0.4]
    T = torch.eye(4)
    T[:3, :3] = torch.tensor([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
    T[2, 3] = float(tea.mesh.extents[2]) + 0.002
    thin = int(np.argmin(tea.mesh.extents[:2]))
    T[:3, :3] = torch.tensor([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]) if thin == 0 else T[:3, :3]
    poses = Hypotheses(T[None], torch.tensor([TYPES.index("WPG")]))
    hand = load_hand(hand_config)
    apart = [Placed(tea, flat), Placed(bottle, beside)]
    assert SceneCheck(apart, hand, 0.1).free(poses).tolist() == [True]
    assert SceneCheck([], hand, 0.1).free(poses).tolist() == [True]
    over = Placed(bottle, above)
    assert SceneCheck([*apart, over], hand, 0.0).free(poses).tolist() == [True]
    assert SceneCheck([*apart, over], hand, 0.4).free(poses).tolist() == [False]
    low = Hypotheses(poses.T + 0, poses.grasp_type)
    low.T[0, 2, 3] -= 0.12  # the palm reaches the box
    assert SceneCheck(apart, hand, 0.1).free(low).tolist() == [False]


def test_a_table_comes_back_as_it_was(tmp_path: Path) -> None:
    made, origin = trials(), {"objects": {"egg": "1f"}, "hand_digest": "2e", "scenes": {"views": [1, 4]}}
    write_scene_trials(tmp_path, made, origin, TYPES)
    again = read_scene_trials(tmp_path / FILE, origin, TYPES)
    assert all(torch.equal(getattr(made, name), getattr(again, name)) for name in made.__dataclass_fields__)
    with pytest.raises(
        InputError, match=r"scene_trials.parquet: expected trials made with these objects, got others: egg"
    ):
        read_scene_trials(tmp_path / FILE, {**origin, "objects": {"egg": "2f"}}, TYPES)
    with pytest.raises(InputError, match=r"expected trials made with these hand_digest, got others: 2f"):
        read_scene_trials(tmp_path / FILE, {**origin, "hand_digest": "2f"}, TYPES)
    with pytest.raises(InputError, match="got no such file; make it: judge \\+context=tabletop"):
        read_scene_trials(tmp_path / "nothing", origin, TYPES)
    content = bytearray((tmp_path / FILE).read_bytes())
    content[40] ^= 1
    (tmp_path / FILE).write_bytes(bytes(content))
    with pytest.raises(InputError, match=FILE):
        read_scene_trials(tmp_path / FILE, origin, TYPES)


def test_judges_are_compared_in_the_same_scenes() -> None:
    """Both of the scene judge's hold, one of the other's two, which was said to hold less likely."""
    found = compared(trials(), MADE)
    assert set(found) == {"1 view, pile", "1 view, all"} and found["1 view, all"] == found["1 view, pile"]
    block = found["1 view, pile"]
    assert block["scenes"] == 3 and block["gain"] == 0.5 and block["gain_interval95"] == [0.5, 0.5]
    old, new = block["object judge"], block["scene judge"]
    assert (old["best"], old["first"], new["best"], new["first"]) == (0.5, 1.0, 1.0, 1.0)
    assert old["auc"] == 1.0 and old["ece"] == pytest.approx((0.2 + 0.6) / 2) and old["trials"] == 6
    told = [
        "1 view, pile",
        "scene judge",
        "100.0",
        "100.0",
        "80.0",
        "0.500",
        "0.200",
        "0.040",
        "+50.0 (+50.0 to +50.0)",
    ]
    assert scene_lines(found)[1] == told
    assert new["auc"] == 0.5 and new["ece"] == pytest.approx(0.2) and new["predicted"] == pytest.approx(0.8)


def scene_rows(count: int = 900) -> SceneRows:
    """Hypotheses whose way is free where `margin` is wide, and that hold where `width` is narrow."""
    numbers = torch.rand(count, len(SCENE_NUMBERS), generator=torch.Generator().manual_seed(2))
    free = numbers[:, SCENE_NUMBERS.index("margin")] > 0.3
    success = free & (numbers[:, SCENE_NUMBERS.index("width")] < 0.5)
    index = torch.arange(count)
    return SceneRows(
        numbers, free, success & (index % 3 > 0), torch.where(index % 3 > 0, 0, -2), index // 30, index % 5
    )


def test_a_judge_that_learned_in_scenes(tmp_path: Path) -> None:
    """It comes back from its files, says of single objects what it said, and knows what matters among others."""
    judge = quick_judge()
    assert not judge.knows_scenes
    factors = learn_scenes(scene_rows(), MADE)
    lessons = SceneLessons(trials(), {None: factors}, {})
    taught = lessons.taught(judge, None)
    save_judge(taught, tmp_path)
    again = load_judge(tmp_path)
    asked = scene_rows(60)
    numbers = asked.numbers[:, :31].clone()
    assert again.knows_scenes and torch.equal(again.probability(numbers, True), judge.probability(numbers, True))
    free, holds = again.both_in_scene(numbers)
    given = again.scene_numbers(numbers)
    for factor, mean in zip(("free", "holds"), (free, holds), strict=True):
        old, new = judge.factors["images", factor].log_odds(numbers), factors["scene", factor].log_odds(given)
        assert mean.logit().numpy() == pytest.approx(((old + new) / 2).numpy(), abs=1e-5)
    p = free * holds
    margin, width = (numbers[:, SCENE_NUMBERS.index(name)] for name in ("margin", "width"))
    good, bad = (margin > 0.4) & (width < 0.4), (margin < 0.2) | (width > 0.6)
    assert p[good].mean() > 2 * p[bad].mean() and 0 < int(good.sum()) < 60
    document = (tmp_path / "judge.json").read_text()
    assert '"scene_numbers"' in document


def test_what_scenes_taught_ranks_among_neighbours_alone() -> None:
    """With proposing=clutter by the third pair of factors, else as if it had never been in a scene."""
    old = quick_judge()
    new = SceneLessons(trials(), {None: learn_scenes(scene_rows(), MADE)}, {}).taught(old, None)
    hand = typed(HandConfig, OmegaConf.to_container(OmegaConf.load(find("conf/hand/sdh2.yaml"))))
    soap = load_object(find("data/objects/soap_bar.yaml"))
    sensing = settings(SensingConfig, width=160, height=120, focal=144, cameras=1)
    texlets, views = observe_on_table(soap.mesh, surround(sensing, np.zeros(3)), sensing, np.random.default_rng(0))
    table = Plane.of((0.0, 0.0, 1.0), float(soap.mesh.bounds[0, 2]))
    seen, around = Seen(texlets, views), Surroundings(table=table, retreat=0.1)
    alone = settings(ProposingConfig)
    among = replace(alone, neighbours=typed(NeighboursConfig, {**NEIGHBOURS, "seeds": 8, "judged": 200}))
    found = {}
    for config in (alone, among):
        for judge in (old, new):
            proposer = JudgedProposer.alone(judge, open_hand(hand), config)
            found[config is among, judge is new] = ranked(judge, proposer.search, config, seen, around)
    assert torch.equal(found[False, False].probability, found[False, True].probability)
    its = found[True, True]
    assert len(its.poses) > 1 and all(number.scene for number in its.numbers)
    numbers = torch.stack([number.values for number in its.numbers])
    free, holds = new.both_in_scene(numbers)
    assert torch.equal(its.probability, (free * holds).float()) and (its.probability.diff() <= 0).all()
    assert not any(number.scene for number in found[True, False].numbers)
    weights = weighed(new, its.numbers[:1])[0]
    assert {weight.name for weight in weights} <= set(NAMES) and weights
