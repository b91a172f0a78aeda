"""From texlets to votes through `torch.compile(fullgraph=True)`: no step leaves the graph.

Inductor's code takes its C++ compiler half a minute of processor: it is tried where SPGF_INDUCTOR=1 is in the
environment.
"""

import os
import shutil
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import GraspModel, kernel_of, learn, vote
from spgf_torch.affordance.pairs import cell_pairs
from spgf_torch.affordance.ranking import point_gains, score_grasps, shrunk_mean
from spgf_torch.affordance.voting import VotingIndex, vote_totals
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import spgf
from spgf_torch.geometry import se3
from spgf_torch.prototypes.kmeans import assign
from spgf_torch.settings import settings

AFFORDANCE = settings(AffordanceConfig, reach=0.04, rotation_deg=45.0, kernel_deg=30.0, min_support=1.0)
FEATURES = settings(FeatureConfig)


inductor = pytest.param(
    "inductor",
    marks=[
        pytest.mark.skipif(os.environ.get("SPGF_INDUCTOR") != "1", reason="slow: SPGF_INDUCTOR=1 asks for it"),
        pytest.mark.skipif(shutil.which("c++") is None, reason="needs a C++ compiler"),
        pytest.mark.filterwarnings("ignore:`torch.jit:DeprecationWarning"),  # Inductor's own imports
    ],
)
backends = pytest.mark.parametrize("backend", ["aot_eager", inductor])


def same_scores(backend: str, scores: Callable[..., Tensor], *given: Tensor) -> None:
    """Compiled without a break and as it is: to the bit, or, where Inductor orders sums anew, up to rounding."""
    found, expected = torch.compile(scores, fullgraph=True, backend=backend)(*given), scores(*given)
    rounding = 1e-6 if backend == "inductor" else 0.0
    torch.testing.assert_close(found, expected, rtol=rounding, atol=rounding, equal_nan=True)
    assert expected.isfinite().sum() > 20


@pytest.fixture(scope="module")
def texlets() -> tuple[Tensor, Tensor]:
    """A bumpy patch of 3 x 3 cm, and one texlet far from it, whose feature is not valid."""
    generator = torch.Generator().manual_seed(0)
    X = (torch.rand(60, 3, generator=generator) - 0.5) * torch.tensor([0.03, 0.03, 0.004])
    n = torch.nn.functional.normalize(torch.tensor([0.0, 0, 1]) + 0.2 * torch.randn(60, 3, generator=generator))
    X[0] = 1.0
    return X, n


@pytest.fixture(scope="module")
def grasps() -> tuple[Tensor, Tensor]:
    return se3.random_poses(50, torch.Generator().manual_seed(1), extent=0.02), torch.arange(50) % 2


@pytest.fixture(scope="module")
def model(texlets: tuple[Tensor, Tensor], grasps: tuple[Tensor, Tensor]) -> GraspModel:
    features = spgf(*texlets, FEATURES)
    centres = features.relations()[[3, 17, 41]]
    pairs = cell_pairs(features.T_object_feature[features.valid], *grasps, AFFORDANCE)
    success = torch.rand(50, generator=torch.Generator().manual_seed(2)) < 0.4
    assert not features.valid[0] and len(kernel_of(AFFORDANCE).turn)
    return learn(
        [(pairs, assign(features.relations()[features.valid], centres), success)], centres, AFFORDANCE, types=2
    )


@backends
def test_scores_of_grasps(
    texlets: tuple[Tensor, Tensor], grasps: tuple[Tensor, Tensor], model: GraspModel, backend: str
) -> None:
    """All sizes are known: votes are added up and never listed. A feature that is not valid is moved out of reach."""
    index = VotingIndex(model.condensed, model.grid)
    table, gains = index.table, point_gains(model.condensed, AFFORDANCE)
    assert len(table.cell)

    def scores(X: Tensor, n: Tensor, T: Tensor, grasp_type: Tensor) -> Tensor:
        features = spgf(X, n, FEATURES)
        away = (~features.valid * 1e3)[:, None, None] * torch.eye(4)[:, 3]
        ids = assign(features.relations(), model.centres)
        found = vote_totals(index, gains, features.T_object_feature + away.mT, ids, T, grasp_type)
        return shrunk_mean(found.log_odds_gain, found.votes, AFFORDANCE)

    same_scores(backend, scores, *texlets, *grasps)


@backends
def test_votes_that_are_listed(
    texlets: tuple[Tensor, Tensor], grasps: tuple[Tensor, Tensor], model: GraspModel, backend: str
) -> None:
    """How many features are valid, pairs within reach and votes found depends on values: torch is told to allow it."""
    index = VotingIndex(model.condensed, model.grid)
    assert len(index.table.cell)

    def scores(X: Tensor, n: Tensor, T: Tensor, grasp_type: Tensor) -> Tensor:
        features = spgf(X, n, FEATURES)
        poses, relations = features.T_object_feature[features.valid], features.relations()[features.valid]
        votes = vote(index, cell_pairs(poses, T, grasp_type, AFFORDANCE), assign(relations, model.centres))
        free = torch.zeros_like(grasp_type, dtype=torch.bool)
        return score_grasps(votes, model.condensed.base_rate, grasp_type, free, AFFORDANCE).log_odds

    with torch._dynamo.config.patch(capture_dynamic_output_shape_ops=True):
        same_scores(backend, scores, *texlets, *grasps)
