"""The whole experiment with a hand of three grasp types: predictions, calibration, the models of the folds."""

import numpy as np
import pytest
import torch
from small_world import FOLD, GRASPS, run, world

TYPES = ("claw", "hook", "pinch")


def test_an_experiment_with_three_types() -> None:
    """Cells and kinds decide: what is ranked first holds more often than chance, of each type; each has its own curve.

    The base rates of a fold's model are shares of successes over pairs, of the four objects that taught it.
    """
    examples = world(cells=4, types=TYPES)
    learned = run(examples)
    better = np.zeros(len(TYPES))
    for scores, example in zip(learned.scores, examples, strict=True):
        assert scores.types == 3 and scores.by_ranking["calibrated"].shape == (GRASPS,)
        for code in range(len(TYPES)):
            its = (example.grasp_type == code).nonzero()[:, 0]
            best = its[scores.by_ranking["calibrated"][its].argsort(descending=True)[:5]]
            better[code] += float(example.outcomes[best].float().mean() - example.outcomes[its].float().mean())
    assert (better / len(examples) > 0.1).all()
    for fold, model in learned.of_fold.items():
        assert model.calibration.numbers.shape == (3, 5)
        taught = [example for example, its in zip(examples, FOLD, strict=True) if its != fold]
        pairs = torch.cat([example.grasp_type[example.pairs.listed().grasp.long()] for example in taught])
        held = torch.cat([example.outcomes[example.pairs.listed().grasp.long()] for example in taught]).float()
        rates = [float(held[pairs == code].mean()) for code in range(3)]
        assert model.condensed.base_rate.tolist() == pytest.approx(rates)
