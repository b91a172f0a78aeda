"""Table 1 of the paper: success-rates in percent, as printed. Class -> type -> rate."""

from __future__ import annotations

from spgf_torch.hands.config import HandConfig, grasp_types

HAND, TYPES = "sdh2", ("NPG", "WPG")

# K: containers NPG WPG CG, boxes NPG WPG CG, curved NPG WPG CG, all NPG WPG CG.
_ROWS = {
    5: (48.0, 26.5, 30.5, 12.9, 80.0, 80.0, 6.3, 93.8, 93.8, 24.8, 63.0, 64.6),
    10: (85.0, 46.5, 59.5, 13.6, 84.3, 84.3, 6.3, 95.0, 95.0, 39.8, 72.6, 77.8),
    15: (82.0, 34.0, 63.0, 14.3, 77.1, 77.1, 6.3, 88.1, 88.1, 38.8, 63.4, 75.0),
    20: (78.0, 40.5, 74.0, 13.6, 87.9, 87.9, 6.3, 92.5, 92.5, 37.0, 70.4, 83.8),
    25: (79.0, 33.5, 71.5, 12.9, 85.7, 85.7, 6.3, 95.6, 95.6, 37.2, 68.0, 83.2),
}
_RANDOM = (10.6, 11.5, None, 4.8, 46.6, None, 4.4, 51.3, None, 7.0, 34.1, None)
# The row [*]: Thomsen et al. (2015), pairs of patches, each class learned by itself: section 5.1 calls it "the
# class-wise approach".
_CLASSWISE = (68.0, None, None, None, 84.0, None, None, 84.0, None, None, None, None)

_COLUMNS = [
    (name, grasp_type) for name in ("containers", "boxes", "curved", "all") for grasp_type in ("NPG", "WPG", "CG")
]

# Said wherever the paper's rates and ours meet.
OTHER_DATA = (
    "The paper's rates are of other objects in another simulator (RobWorkSim; here SAPIEN); the random rates of "
    "data/objects with the SDH-2 were calibrated to the paper's."
)


def _table(row: tuple[float | None, ...]) -> dict[str, dict[str, float]]:
    table: dict[str, dict[str, float]] = {}
    for (name, grasp_type), rate in zip(_COLUMNS, row, strict=True):
        if rate is not None:
            table.setdefault(name, {})[grasp_type] = rate
    return table


def is_papers_hand(hand: HandConfig) -> bool:
    """Whether the paper's rates may stand beside those of a hand: it is the paper's, with its two preshapes."""
    return hand.name == HAND and grasp_types(hand) == TYPES


SUCCESS_RATE = {K: _table(row) for K, row in _ROWS.items()}
RANDOM = _table(_RANDOM)
CLASSWISE = _table(_CLASSWISE)
