"""Which descriptor the settings name (`features.descriptor`): SPGF, or a baseline in its place."""

from __future__ import annotations

from collections.abc import Callable

from torch import Generator, Tensor

from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.fpfh import BINS, fpfh, open3d_version
from spgf_torch.features.interface import LocalFeatures
from spgf_torch.features.patch_pairs import NUMBERS, patch_pairs
from spgf_torch.features.spgf import spgf

# Describes texlets by positions (N, 3) m, unit normals (N, 3), settings, and a source of random draws.
Descriptor = Callable[[Tensor, Tensor, FeatureConfig, Generator | None], LocalFeatures]

# Those of `config.DESCRIPTORS`.
_BY_NAME: dict[str, Descriptor] = {"spgf": spgf, "fpfh": fpfh, "patch_pairs": patch_pairs}


def descriptor(config: FeatureConfig) -> Descriptor:
    """The function that describes texlets as the settings say."""
    return _BY_NAME[config.descriptor]


def width(config: FeatureConfig) -> int:
    """How many numbers the relations of one feature are."""
    return {"spgf": 2 * 2 * config.cells, "fpfh": BINS, "patch_pairs": NUMBERS}[config.descriptor]


def library(config: FeatureConfig) -> str:
    """Name and version of what the descriptor needs beside this package's dependencies; empty where nothing.

    Raises InputError where it is not installed.
    """
    return f"open3d {open3d_version()}" if config.descriptor == "fpfh" else ""
