"""The shipped hand and a parallel jaw, loaded once (pytorch-kinematics takes seconds to import)."""

import pytest
from trial_objects import jaw_settings, parallel_jaw

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.execute import Trials


@pytest.fixture(scope="session")
def hand() -> Hand:
    return load_hand(settings(HandConfig))


@pytest.fixture(scope="session")
def trials(hand: Hand) -> Trials:
    return Trials(hand, settings(EpisodeConfig))


@pytest.fixture(scope="session")
def jaw(tmp_path_factory: pytest.TempPathFactory) -> Hand:
    """Its fingers close to the middle and no further."""
    path = tmp_path_factory.mktemp("jaw") / "jaw.urdf"
    path.write_text(parallel_jaw())
    return load_hand(typed(HandConfig, jaw_settings(str(path))))
