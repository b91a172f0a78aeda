"""The shipped hand, loaded once (pytorch-kinematics takes seconds to import)."""

import pytest

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.settings import settings


@pytest.fixture(scope="session")
def hand() -> Hand:
    return load_hand(settings(HandConfig))
