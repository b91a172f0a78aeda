"""Settings: every room's defaults load, wrong ones are told in one line, the doors' configs compose."""

from dataclasses import fields
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from spgf_torch import config
from spgf_torch.cli.door import slug
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import EvaluateConfig, TrainConfig
from spgf_torch.settings import plain, settings, typed
from spgf_torch.simulation.config import SimulateConfig

CONF = Path(__file__).parents[1] / "conf"
OmegaConf.register_new_resolver("slug", slug, replace=True)


def composed(command: str, *overrides: str) -> dict:
    with initialize_config_dir(str(CONF), version_base="1.3"):
        values = OmegaConf.to_container(compose(command, overrides=list(overrides)), resolve=True)
    assert isinstance(values, dict)
    return values


@pytest.mark.parametrize("kind", config.DEFAULTS, ids=lambda kind: kind.__name__)
def test_every_rooms_defaults_load(kind: type) -> None:
    loaded = settings(kind)
    written = OmegaConf.load(CONF / config.DEFAULTS[kind])
    assert {f.name for f in fields(kind)} == set(written)  # the YAML names every key, and no other
    assert typed(kind, plain(loaded)) == loaded


@pytest.mark.parametrize("K", ["+K=7", "K=7"])
def test_k_is_the_number_of_clusters_however_it_is_given(K: str) -> None:
    values = composed("train", K)
    assert values["K"] == values["prototypes"]["num_clusters"] == 7


def test_without_k_there_are_20_prototypes() -> None:
    values = composed("train")
    assert values["K"] == "???" and values["prototypes"]["num_clusters"] == 20


def test_doors_compose() -> None:
    assert typed(TrainConfig, composed("train", "K=20")).features == settings(config.FeatureConfig)
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


def test_slug_is_a_folder_name() -> None:
    assert slug("") == ""
    assert slug("+K=20,features.radius=0.02") == "_K=20,features.radius=0.02"
    assert "/" not in slug("x=../a b")
