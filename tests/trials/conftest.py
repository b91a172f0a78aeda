"""The shipped hand, loaded once (pytorch-kinematics takes seconds to import)."""

import pytest

from spgf_torch.config import EpisodeConfig, HandConfig, settings
from spgf_torch.trials.hand import Hand, load_hand
from spgf_torch.trials.runner import Trials


@pytest.fixture(scope="session")
def hand() -> Hand:
    return load_hand(settings(HandConfig))


@pytest.fixture(scope="session")
def trials(hand: Hand) -> Trials:
    return Trials(hand, settings(EpisodeConfig))
