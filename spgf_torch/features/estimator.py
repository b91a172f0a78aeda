"""SPGF with its settings, as one object that describes surfaces (paper, section 3.1)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import Features, spgf
from spgf_torch.settings import settings

__all__ = ["SPGF"]

Numbers = Tensor | np.ndarray[Any, Any]


class SPGF:
    """Sliced Pineapple Grid Features: `SPGF()(positions, normals)` describes the surroundings of each texlet.

    The same as the function `spgf_torch.features.spgf.spgf`, whose settings are kept here.

    Args:
        changes: settings of conf/features, such as `radius=0.02` (m) or `alignment="soft"`; the others are the paper's.

    Attributes:
        config: all settings.

    Raises:
        InputError: a setting that there is not, or is out of range.

    A flat square of 9 x 9 texlets, 10 mm apart, has no curvature in its middle:

    >>> import torch
    >>> from spgf_torch import SPGF
    >>> at = 0.01 * torch.arange(9.0)
    >>> positions = torch.cartesian_prod(at, at, torch.zeros(1))
    >>> normals = torch.tensor([0.0, 0.0, 1.0]).expand(81, 3)
    >>> features = SPGF(radius=0.03)(positions, normals)
    >>> features.T_object_feature.shape, features.relations().shape
    (torch.Size([81, 4, 4]), torch.Size([81, 144]))
    >>> bool((features.rings[40, 0] == 0).all())
    True
    """

    def __init__(self, **changes: Any) -> None:
        self.config = settings(FeatureConfig, **changes)
        if self.config.descriptor != "spgf":
            raise InputError(
                f"descriptor: expected spgf, got {self.config.descriptor}; spgf_torch.features has a function for it"
            )

    def __call__(self, positions: Numbers, normals: Numbers, generator: torch.Generator | None = None) -> Features:
        """Describe N texlets, evenly spaced as `Scene.texlets` are.

        Args:
            positions: (N, 3) m. normals: (N, 3) unit, out of the surface, same frame; float32 or float64, both alike.
            generator: of the alignment `random`, the only one that draws.

        Raises:
            InputError: other shapes or types, NaN or infinite values, normals that are not unit vectors.
        """
        return spgf(tensor_of("positions", positions), tensor_of("normals", normals), self.config, generator)

    def __repr__(self) -> str:
        told = ", ".join(f"{name}={value!r}" for name, value in vars(self.config).items() if name != "descriptor")
        return f"SPGF({told})"


def tensor_of(name: str, values: Numbers) -> Tensor:
    """An array or tensor as a tensor, which shares its memory where it can. InputError for anything else."""
    try:
        if isinstance(values, Tensor | np.ndarray):
            return torch.as_tensor(values)
    except (TypeError, ValueError):  # an array of words or objects; of a byte order or strides that torch has not
        pass
    got = values.dtype if isinstance(values, np.ndarray) else type(values).__name__
    raise InputError(f"{name}: expected a torch tensor or a numpy array of numbers, got {got}")
