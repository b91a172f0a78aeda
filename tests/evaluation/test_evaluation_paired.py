"""Paired differences of two methods on the same objects; objects without grasps of a type."""

import numpy as np
import pytest

from spgf_torch.evaluation.success import bootstrap_interval, paired_difference, top_n


def test_paired_difference_by_hand() -> None:
    """Boxes: (0.5 - 0.3 + 0.9 - 0.7) / 2 = 0.2; curved: 0.1 - 0.4 = -0.3; all: (0.2 + 0.2 - 0.3) / 3 = 1/30.

    Both boxes differ by 0.2, so every resample of them does too: an interval of no width.
    """
    ours, theirs = [{"CG": 0.5}, {"CG": 0.9}, {"CG": 0.1}], [{"CG": 0.3}, {"CG": 0.7}, {"CG": 0.4}]
    means, intervals = paired_difference(["boxes", "boxes", "curved"], ours, theirs, 200, seed=0)
    assert {name: rates["CG"] for name, rates in means.items()} == pytest.approx(
        {"boxes": 0.2, "curved": -0.3, "all": 1 / 30}
    )
    assert intervals["boxes"]["CG"] == pytest.approx([0.2, 0.2])


def test_pairing_is_narrower_than_two_intervals() -> None:
    """Objects spread over 0 to 1, one method better by 0.1 on each: the difference is certain, the means are not."""
    easy = np.linspace(0, 0.9, 30)
    ours, theirs = [{"CG": float(rate + 0.1)} for rate in easy], [{"CG": float(rate)} for rate in easy]
    classes = ["containers"] * 30
    _, paired = paired_difference(classes, ours, theirs, 500, seed=0)
    alone = bootstrap_interval(classes, ours, 500, seed=0)
    assert np.ptp(paired["all"]["CG"]) < 1e-9 < 0.1 < np.ptp(alone["all"]["CG"])


def test_a_type_without_grasps_succeeds_never() -> None:
    score, success = np.array([1.0, 2.0]), np.array([True, True])
    assert top_n(score, success, np.array([0, 0]), 10, ("NPG", "WPG")) == {"NPG": 1.0, "WPG": 0.0, "CG": 1.0}
