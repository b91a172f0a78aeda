"""Fast Point Feature Histograms (Rusu, Blodow, Beetz 2009) by Open3D: a baseline that knows no direction.

The histograms say what the surroundings look like and not which way they lie, and shape-grasp particles need a
whole frame: a feature has the pose of the SPGF at the same texlet (`features.alignment` included). What is compared
is the relational part alone.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

import numpy as np
import torch
from torch import Generator, Tensor

from spgf_torch.extras import needed
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.interface import VectorFeatures
from spgf_torch.features.spgf import spgf

# What each of the three histograms sums to in Open3D: 100 of the point itself and 100 of its neighbours.
OPEN3D_SUM = 200.0

BINS = 33  # of the three together


def fpfh(
    positions: Tensor, normals: Tensor, config: FeatureConfig, generator: Generator | None = None
) -> VectorFeatures:
    """FPFH of each of N texlets within `config.radius`: 3 histograms of 11 bins, each of which sums to 1.

    positions, normals, generator, and the errors that are raised: as for `spgf`. Open3D works on the CPU, in float64.

    Raises InputError where Open3D is not installed.
    """
    open3d_version()
    import open3d  # more than a second: only where it is asked for

    posed = spgf(positions, normals, config, generator)
    if len(positions) == 0:  # which Open3D refuses
        return VectorFeatures(posed.T_object_feature, positions.new_zeros((0, BINS)).float(), posed.valid)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(_array(positions)))
    cloud.normals = open3d.utility.Vector3dVector(_array(normals))
    search = open3d.geometry.KDTreeSearchParamRadius(config.radius)
    histograms = open3d.pipelines.registration.compute_fpfh_feature(cloud, search).data
    vectors = torch.from_numpy(histograms.T / OPEN3D_SUM).float().to(positions.device)
    return VectorFeatures(posed.T_object_feature, vectors, posed.valid)


def open3d_version() -> str:
    """The version of Open3D. Raises InputError where there is none."""
    needed("features.descriptor: fpfh", "open3d")
    try:
        return version("open3d-cpu")
    except PackageNotFoundError:
        return version("open3d")


def _array(values: Tensor) -> np.ndarray:
    return values.detach().cpu().double().numpy()
