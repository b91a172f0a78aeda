"""One trial in SAPIEN: the sanity set that any change must keep (docs/design/simulation.md), and exact repetition."""

import pickle
import shutil
import subprocess
import sys

import numpy as np
import pytest
from composing import composed
from trial_objects import ball, bin_, box, can, cup, from_above, from_side

from spgf_torch.hands.config import grasp_types
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import root
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.episode import Simulator, Trial
from spgf_torch.simulation.precheck import PreCheck
from spgf_torch.simulation.table import OUTCOMES, read_table


def outcome(hand, obj, T, kind, **changes):
    if PreCheck(obj, hand.preshapes[kind]).collides(T):
        return "collision"
    return Simulator(obj, hand, settings(EpisodeConfig, **changes)).run(T, kind)


HELD = {
    "can, 0.5": (can(), from_side(0.06), "WPG", 0.5),
    "can, 0.8": (can(), from_side(0.06), "WPG", 0.8),
    "ball, 0.5": (ball(), from_above(0.035), "WPG", 0.5),
    "ball, 0.8": (ball(), from_above(0.035), "WPG", 0.8),
    "0.8 kg": (can(mass=0.8), from_side(0.06), "WPG", 0.6),
    "rim of a mug": (cup(), from_above(0.08, x=0.0385), "NPG", 0.6),
    "rim of a jar": (cup(0.035, 0.12, 0.004, 0.3), from_above(0.11, x=0.033), "NPG", 0.6),
    "rim of a thin bin": (bin_(), from_above(0.14, x=0.09925), "NPG", 0.6),
    "mug from outside": (cup(), from_side(0.05), "WPG", 0.6),
    "38 mm box": (box((0.038, 0.06, 0.1)), from_side(0.05), "WPG", 0.6),
    "65 mm box": (box((0.065, 0.06, 0.1)), from_side(0.05), "WPG", 0.6),
}


# object of data/trials -> rows of it
SHIPPED = {"carton_rice": (1008, 1026, 1030), "flashlight": (4, 7), "saucepan": (5, 29)}

EPISODES = {"pinch": {}, "fast": {"dt": 0.005, "position_iterations": 56}}


@pytest.mark.parametrize("episode", EPISODES)
@pytest.mark.parametrize("case", HELD)
def test_held(hand, case, episode):
    obj, T, kind, friction = HELD[case]
    assert outcome(hand, obj, T, kind, friction=friction, **EPISODES[episode]) == "success"


@pytest.mark.parametrize("episode", EPISODES)
@pytest.mark.parametrize(
    ("obj", "T", "friction"),
    [(can(), from_side(0.06), 0.05), (ball(), from_above(0.035), 0.05), (can(mass=2.0), from_side(0.06), 0.6)],
    ids=["slippery can", "slippery ball", "2 kg"],
)
def test_not_held(hand, obj, T, friction, episode):
    assert outcome(hand, obj, T, "WPG", friction=friction, **EPISODES[episode]) in ("dropped", "slipped")


@pytest.mark.parametrize("episode", EPISODES)
def test_empty_space_is_missed(hand, episode):
    assert outcome(hand, can(), from_above(0.3), "WPG", **EPISODES[episode]) == "missed"


def test_fast_is_the_same_episode_in_other_steps():
    """What EPISODES says of it here, and nothing else."""
    fast = typed(EpisodeConfig, composed("simulate", "episode=fast")["episode"])
    assert fast == settings(EpisodeConfig, **EPISODES["fast"])


def test_the_shipped_table_comes_out_again(hand, tmp_path):
    """Trials of data/trials of various outcomes that end alike at dt 1/2000; so they do in the fast episode."""
    for name in SHIPPED:
        shutil.copy(root() / f"data/objects/{name}.yaml", tmp_path)
    for obj in load_objects(tmp_path):
        table = read_table(root() / f"data/trials/{obj.name}.parquet")
        for changes in EPISODES.values():
            simulator = Simulator(obj, hand, settings(EpisodeConfig, **changes))
            for row in SHIPPED[obj.name]:
                kind = grasp_types(hand.config)[table.grasp_type[row]]
                assert simulator.run(table.T_object_tcp[row].numpy(), kind) == OUTCOMES[table.outcome[row]]


def test_ball_wider_than_the_opening_collides(hand):
    assert outcome(hand, ball(), from_above(0.035), "NPG") == "collision"


def test_held_at_the_end_of_a_long_bar_turns(hand):
    """0.6 kg held 15 cm from its centre: 0.88 Nm against pads that hold about 0.2 Nm. The bar tips out of the hand."""
    bar = box((0.03, 0.34, 0.03), mass=0.6)
    T = from_above(0.02)
    T[1, 3] = 0.15
    assert outcome(hand, bar, T, "WPG") in ("rotated", "slipped", "dropped")


def test_precheck_sees_the_parts_not_the_hull(hand):
    """A hand reaching over a cup's rim is free though it cuts the convex hull; shifted into the wall it is not."""
    check = PreCheck(cup(), hand.preshapes["NPG"])
    assert not check.collides(from_above(0.08, x=0.0385))
    assert check.collides(from_above(0.08, x=0.0385 + 0.0225))


def last_states(hand, order):
    """Six trials on three objects, in this order: what is left of each, to the last bit, sorted by trial."""
    config = settings(EpisodeConfig)
    simulators = [Simulator(obj, hand, config) for obj in (cup(), can(), box((0.05, 0.06, 0.1)))]
    states = []
    for k in order:
        trial = Trial(simulators[k % 3], from_side(0.04 + 0.002 * k).astype(np.float64), "WPG")
        outcome, pose = trial.run(), trial.object.entity.pose
        states.append((k, outcome, (pose.p.tobytes() + pose.q.tobytes() + trial.articulation.qpos.tobytes()).hex()))
    return sorted(states)


def test_trials_repeat_bit_for_bit_in_any_order_and_process(hand, request):
    """The object's last pose and the fingers', not only the outcome."""
    folders = [str(folder) for folder in request.path.parents[:2]]
    code = (
        f"import pickle, sys; sys.path[:0] = {folders!r}; from test_episode import last_states; "
        "print(last_states(pickle.load(sys.stdin.buffer), [5, 2, 0, 4, 1, 3]))"
    )
    other = subprocess.run([sys.executable, "-c", code], input=pickle.dumps(hand), capture_output=True, check=True)
    here = last_states(hand, range(6))
    assert [outcome for _, outcome, _ in here].count("success") >= 3
    assert other.stdout.decode().strip() == str(here)


def test_a_parallel_jaw_grasps_with_the_same_code(jaw):
    T = from_above(0.08).astype(np.float64)
    assert outcome(jaw, box((0.038, 0.06, 0.1)), T, "WPG") == "success"
    assert outcome(jaw, box((0.06, 0.06, 0.1)), T, "NPG") == "collision"
