"""SPGF as one object: the function with its settings, for arrays and tensors."""

import numpy as np
import pytest
import torch

from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.estimator import SPGF
from spgf_torch.features.spgf import spgf
from spgf_torch.settings import settings


def ball() -> tuple[torch.Tensor, torch.Tensor]:
    normals = torch.nn.functional.normalize(torch.randn(300, 3, generator=torch.Generator().manual_seed(0)))
    return 0.04 * normals, normals


def test_the_function_with_its_settings() -> None:
    found, expected = (
        SPGF(radius=0.02, cells=12)(*ball()),
        spgf(*ball(), settings(FeatureConfig, radius=0.02, cells=12)),
    )
    assert torch.equal(found.rings, expected.rings)
    assert torch.equal(found.T_object_feature, expected.T_object_feature)


def test_arrays_are_taken_as_they_are() -> None:
    found = SPGF()(*(part.double().numpy() for part in ball()))
    assert found.rings.dtype == torch.float64 and len(found) == 300


def test_random_alignment_by_a_generator() -> None:
    describe = SPGF(alignment="random")
    first, again, other = (describe(*ball(), torch.Generator().manual_seed(seed)).rings for seed in (0, 0, 1))
    assert torch.equal(first, again) and not torch.equal(first, other)
    with pytest.raises(InputError, match="random expected a generator"):
        describe(*ball())


def test_what_it_does_not_take() -> None:
    with pytest.raises(InputError, match="descriptor: expected spgf, got fpfh"):
        SPGF(descriptor="fpfh")
    with pytest.raises(InputError, match="positions: expected a torch tensor or a numpy array of numbers, got list"):
        SPGF()([[0.0, 0.0, 0.0]], np.zeros((1, 3)))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="raduis"):
        SPGF(raduis=0.02)


def test_its_settings_are_told() -> None:
    assert repr(SPGF()).startswith("SPGF(radius=0.03, cells=36, half_length=6, alignment='argmax'")
