"""What tests take for Hydra's composition is Hydra's."""

import pytest
from composing import by_hydra, composed
from hydra.errors import HydraException
from omegaconf import OmegaConf


@pytest.mark.parametrize(
    ("command", "overrides"),
    [
        ("train", ("K=4", "seed=-3", "sensing.width=160", "objects='a b'")),
        ("train", ("hand=panda", "+judging.rounds=2", "hand.closing={effort:2}", "K=5")),
        ("train", ("+comparison=random_axis", "prototypes.num_clusters=7")),
        ("predict", ("viewpoints=[[0,0,0],[1,2,3]]", "input=x", "crop_low=[0,0,1]")),
    ],
)
def test_values_are_changed_as_hydra_does(command: str, overrides: tuple[str, ...]) -> None:
    """Twice: what was changed before is not in what is given next."""
    for _ in range(2):
        assert composed(command, *overrides) == OmegaConf.to_container(by_hydra(command, overrides), resolve=True)
    assert composed(command) == OmegaConf.to_container(by_hydra(command, ()), resolve=True)


@pytest.mark.parametrize("wrong", ["KK=3", "hand.nope=3", "K.a=3", "episode=nobody"])
def test_what_hydra_refuses_is_refused_by_it(wrong: str) -> None:
    with pytest.raises(HydraException, match=r"Could not (find|override)"):
        composed("train", wrong)
