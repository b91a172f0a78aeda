"""What a judge weighed, in words and units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from spgf_torch.proposing.judge_influences import Weight

SHOWN = 6  # numbers that are shown of a grasp
# Name of a number (`judge_features`) -> words, how it is printed and what it is multiplied by before.
_PERCENT, _MM, _PLAIN = ("{:.0f} %", 100.0), ("{:.0f} mm", 1000.0), ("{:.2f}", 1.0)
_WORDS: dict[str, tuple[str, tuple[str, float]]] = {
    "type": ("grasp type", _PLAIN),
    "margin": ("nearest point to the hand", _MM),
    "log_points": ("points between the pads (log)", _PLAIN),
    "width": ("seen width of the opening", _PERCENT),
    "off_mid": ("seen middle off the hand's", _MM),
    "mean_z": ("seen middle along the approach", _MM),
    "anti_min": ("worse pad within the friction cone", _PERCENT),
    "anti_max": ("better pad within the friction cone", _PERCENT),
    "n_min": ("worse pad faced by the surface (cosine)", _PLAIN),
    "n_max": ("better pad faced by the surface (cosine)", _PLAIN),
    "both_sides": ("both sides seen", _PERCENT),
    "log_both": ("points of the rarer side (log)", _PLAIN),
    "reach": ("depth past the nearest point", _MM),
    "c_x": ("object's middle along closing", _MM),
    "c_y": ("object's middle across", _MM),
    "c_z": ("object's middle along the approach", _MM),
    "c_arm": ("object's middle off the closing axis", _MM),
    "span": ("object along closing, of the opening", _PERCENT),
    "size_1": ("object's length (rms)", _MM),
    "size_2": ("object's width (rms)", _MM),
    "size_3": ("object's height (rms)", _MM),
    "views": ("number of views", ("{:.0f}", 1.0)),
    "from_seen": ("comes from the cameras' side (cosine)", _PLAIN),
    "finger_near": ("fingers just behind the seen surface", _PERCENT),
    "finger_mid": ("fingers behind the seen surface", _PERCENT),
    "finger_far": ("fingers far behind the seen surface", _PERCENT),
    "worst_finger": ("unseen space in the worse finger", _PERCENT),
    "best_finger": ("unseen space in the better finger", _PERCENT),
    "palm": ("unseen space in the palm", _PERCENT),
    "sweep": ("unseen space between the pads", _PERCENT),
    "sweep_depth": ("depth of unseen space between the pads", _MM),
}


@dataclass(frozen=True)
class WeighedNumber:
    """A number of a grasp in words: what it is, its value and the usual one, and how far it moved the log-odds."""

    words: str
    value: str
    usual: str
    moved: float


def weighed_words(weights: Sequence[Weight], grasp_types: Sequence[str]) -> tuple[WeighedNumber, ...]:
    """The numbers that moved the judge most: `unseen space in the worse finger`, `0 %`, `31 %`, +0.8.

    Args:
        grasp_types: of the judge's hand, sorted.
    """
    told = []
    for weight in weights[:SHOWN]:
        words, (form, factor) = _WORDS.get(weight.name, (weight.name, _PLAIN))
        if weight.name == "type":
            value, usual = (grasp_types[round(number)] for number in (weight.value, weight.usual))
        else:
            value, usual = (form.format(factor * number + 0.0) for number in (weight.value, weight.usual))
        told.append(WeighedNumber(words, value, usual, weight.moved))
    return tuple(told)
