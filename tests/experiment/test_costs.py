"""Of which objects the time of a prediction is the median."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

from spgf_torch.cache import Cache
from spgf_torch.experiment import costs


@dataclass(frozen=True)
class Describing:
    cache: Any = "one that knows all answers"


@pytest.mark.parametrize(("objects", "milliseconds"), [(20, 8000), (3, 1000), (1, 0), (11, 5000)])
def test_the_median_of_a_few_objects(objects: int, milliseconds: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Object i takes i seconds. Of 20 objects every fourth is asked, of 11 every second, of up to 9 each.

    So the medians are those of 0, 4, ..., 16; of 0, 2, ..., 10; and of all. None comes from a cache.
    """

    def seconds(loaded: Any, obj: int, tried: str) -> float:
        assert isinstance(loaded.describer.cache, Cache) and tried == f"grasps of {obj}"
        return float(obj)

    monkeypatch.setattr(costs, "_seconds", seconds)
    monkeypatch.setattr(costs, "LoadedModel", lambda model, describer: SimpleNamespace(describer=describer, index=0))
    its: Any = list(range(objects))
    tried: Any = [f"grasps of {i}" for i in its]
    assert costs.prediction_ms(None, Describing(), its, tried) == milliseconds
