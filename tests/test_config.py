"""Settings: every room's defaults load, wrong ones are told in one line, the commands' configs compose."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from composing import composed
from omegaconf import OmegaConf

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.clearing.config import ClutterConfig
from spgf_torch.cli.command import slug
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import EvaluateConfig, TrainConfig
from spgf_torch.features.config import FeatureConfig
from spgf_torch.hands.config import HandConfig
from spgf_torch.judging.config import TreesConfig
from spgf_torch.objects.config import CollisionConfig
from spgf_torch.proposing.config import HypothesesConfig, ProposingConfig
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.scene.config import SceneConfig
from spgf_torch.second_engine.config import MujocoConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import LEFT_OUT, plain, settings, typed
from spgf_torch.simulation.clutter_config import ArrangementConfig, AttemptConfig
from spgf_torch.simulation.config import EpisodeConfig, SamplerConfig, SimulateConfig

CONF = Path(__file__).parents[1] / "conf"
OmegaConf.register_new_resolver("slug", slug, replace=True)


ROOMS = (
    AffordanceConfig,
    ArrangementConfig,
    AttemptConfig,
    CollisionConfig,
    EpisodeConfig,
    FeatureConfig,
    HandConfig,
    HypothesesConfig,
    MujocoConfig,
    PrototypeConfig,
    ProposingConfig,
    SamplerConfig,
    SceneConfig,
    SensingConfig,
    TreesConfig,
)


def test_what_a_robot_adds_is_named_only_where_it_is_given() -> None:
    """So that the provenance of the paper's episode is what it was."""
    assert "robot" not in plain(settings(EpisodeConfig)) and "robot" not in plain(SimulateConfig().episode)
    robot = composed("simulate", "episode=robot")["episode"]
    assert plain(typed(EpisodeConfig, robot)) == robot and robot["robot"]["mass_spread"] == 0.5
    fast = composed("simulate", "episode=robot_fast")["episode"]
    assert {key for key in robot["robot"] if fast["robot"][key] != robot["robot"][key]} == {"fast_forward"}
    robot["robot"]["floating"] = 2
    with pytest.raises(InputError, match=r"^robot\.floating: expected a number from 0 to 1, got 2"):
        typed(EpisodeConfig, robot)
    with pytest.raises(InputError, match=r"robot\.\w+: expected a value, got none"):
        typed(EpisodeConfig, {**robot, "robot": {"floating": 0.5}})


@pytest.mark.parametrize("kind", ROOMS, ids=lambda kind: kind.__name__)
def test_every_rooms_defaults_load(kind: Any) -> None:
    loaded = settings(kind)
    written = OmegaConf.load(CONF / kind.DEFAULTS)
    extra = {
        entry.name for entry in fields(kind) if entry.metadata.get(LEFT_OUT)
    }  # the YAML may say that there is none
    named = {entry.name for entry in fields(kind)} - extra
    # The YAML has every key, and no other; a hand what it needs.
    assert set(written) < named if kind is HandConfig else set(written) - extra == named
    assert typed(kind, plain(loaded)) == loaded


@pytest.mark.parametrize("kind", [kind for kind in ROOMS if kind is not HandConfig], ids=lambda kind: kind.__name__)
def test_an_instance_has_the_defaults_that_are_written(kind: Any) -> None:
    assert kind() == settings(kind)


def test_a_changed_instance_keeps_the_other_defaults_and_shares_none() -> None:
    changed = FeatureConfig(radius=0.02)
    assert (changed.radius, changed.cells, FeatureConfig().radius) == (0.02, 36, 0.03)


def test_what_is_read_twice_is_shared_with_nobody() -> None:
    """The same values are checked once; each call gets an instance of its own."""
    values = plain(settings(HandConfig))
    first = typed(HandConfig, values)
    first.fingers.clear()
    assert plain(typed(HandConfig, values)) == values and values["fingers"]
    sensing = plain(settings(SensingConfig))
    for given in (2, 2.0):
        assert type(typed(SensingConfig, sensing | {"distance": given}).distance) is float
    with pytest.raises(InputError, match="distance"):
        typed(SensingConfig, sensing | {"distance": "wide"})


def test_what_is_read_from_elsewhere_must_give_every_value() -> None:
    values = plain(settings(FeatureConfig))
    del values["cells"]
    with pytest.raises(InputError, match=r"^cells: expected a value, got none"):
        typed(FeatureConfig, values)
    whole = composed("train", "K=20")
    del whole["sensing"]["spacing"]
    with pytest.raises(InputError, match=r"^sensing\.spacing: expected a value, got none"):
        typed(TrainConfig, whole)


@pytest.mark.parametrize("K", ["+K=7", "K=7"])
def test_k_is_the_number_of_clusters_however_it_is_given(K: str) -> None:
    values = composed("train", K)
    assert values["K"] == values["prototypes"]["num_clusters"] == 7


def test_without_k_there_are_20_prototypes() -> None:
    values = composed("train")
    assert values["K"] == "???" and values["prototypes"]["num_clusters"] == 20


def test_commands_compose() -> None:
    assert typed(TrainConfig, composed("train", "K=20")).features == settings(FeatureConfig)
    assert typed(SimulateConfig, composed("simulate")).candidates == 1000
    assert typed(EvaluateConfig, composed("evaluate", "objects=x")).N == 10


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("K=12.5", ["12.5", "Integer"]),
        ("K=null", ["None"]),
        ("K=0", ["K", "1 to 1000", "got 0"]),
        ("ranking=best", ["ranking", "paper", "got best"]),
        ("seed=-1", ["seed", "got -1"]),
        ("+features.bogus=1", ["features.bogus", "FeatureConfig"]),
        ("folds=1", ["folds", "2 to 50"]),
        ("classwise=maybe", ["classwise: expected true or false, got maybe"]),
        ("seed=seed", ["seed: expected a value of type Integer, got seed"]),
        ("device=3.5.1", []),
    ],
)
def test_wrong_settings_are_told_in_one_line(override: str, words: list[str]) -> None:
    values = composed("train", *(["K=5"] if "K=" not in override else []), override)
    if not words:
        assert typed(TrainConfig, values).device == "3.5.1"  # a string: what it means is for torch to say
        return
    with pytest.raises(InputError) as error:
        typed(TrainConfig, values)
    assert "\n" not in str(error.value) and all(word in str(error.value) for word in words)


def test_one_value_in_the_place_of_a_list_is_told() -> None:
    with pytest.raises(InputError, match=r"^beside: expected a list, as \[A,B\]; got one value$"):
        typed(ClutterConfig, composed("clutter", "beside=folder"))


def test_slug_is_a_folder_name() -> None:
    assert slug("") == ""
    assert slug("+K=20,features.radius=0.02") == "_K=20,features.radius=0.02"
    assert "/" not in slug("x=../a b")
