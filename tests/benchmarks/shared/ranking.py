"""The methods that `peers.py` compares, and what each ranks for a cloud in how many seconds of the processor."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from shared.contact_graspnet import raw_cloud
from shared.harness import Report, threads
from spgf_torch.affordance.model import load_model
from spgf_torch.clearing.contact_graspnet import ContactGraspNet
from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.hands.config import HandConfig
from spgf_torch.judging.clouds import Cloud
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import find
from spgf_torch.proposing.antipodal import antipodal
from spgf_torch.proposing.clearance import Clearance
from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.proposing.judge import Judge
from spgf_torch.proposing.judge_features import in_images
from spgf_torch.proposing.judge_proposer import Ranked, ranked
from spgf_torch.proposing.propose import Proposer
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings, typed

JUDGE, NETWORK, FREE = "judge", "Contact-GraspNet", "Contact-GraspNet, free"
SCORES = ("antipodal", "random")  # which rank by no probability
WIDE = ("NPG", "WPG").index("WPG")  # the network's hand is open to its whole stroke
Method = Callable[[Cloud], Ranked]


@dataclass(frozen=True)
class Sensed:
    """An object, the settings and the seed it was sensed with, and what was seen."""

    obj: GraspObject
    sensing: SensingConfig
    seed: int
    cloud: Cloud


@dataclass(frozen=True)
class Timed:
    """What a method ranked for one cloud, and its seconds of the processor."""

    ranked: Ranked
    seconds: float


@dataclass(frozen=True)
class Peers:
    """Who takes part: the hand, the search they share, how each of ours ranks, and the network, where it is there."""

    hand: HandConfig
    search: Search
    ours: dict[str, Method]
    network: ContactGraspNet | None


def peers(judge: Judge, given: dict[str, str], report: Report) -> Peers:
    """Raises InputError for a model of another hand, and for a `cgn` that does not run."""
    hand, config = typed(HandConfig, judge.settings["hand"]), settings(ProposingConfig)
    clearance = Clearance(open_hand(hand), config.plane_clearance, config.between, config.obstacle_clearance)
    search = Search.of(clearance, judge.hypotheses)
    ours: dict[str, Method] = {
        JUDGE: lambda cloud: ranked(judge, search, config, cloud.seen, cloud.around),
        "antipodal": lambda cloud: antipodal(search, config, cloud.seen, cloud.around),
        "random": lambda cloud: at_random(search, cloud),
    }
    if "model" in given:
        model = load_model(find(given["model"]))
        judge.check_hand(model.settings.get("hand"), "the model's hand")
        proposer = Proposer.of(model, config, open_hand(hand))
        ours["votes"] = lambda cloud: voted(proposer, cloud)
    network = None
    if "cgn" not in given:
        report.skip("Contact-GraspNet: no cgn=PYTHON was given (spgf_torch/clearing/contact_graspnet.py)")
    elif hand.name != "panda":
        report.skip(f"Contact-GraspNet: its hand is the Panda, the judge's {hand.name}")
    else:
        network = ContactGraspNet.of(given["cgn"])
    return Peers(hand, search, ours, network)


def at_random(search: Search, cloud: Cloud) -> Ranked:
    """Free hypotheses, those that the judge gets, in an order drawn for this cloud.

    One seed for all would try the same indices everywhere, which are of the same type and depth.
    """
    found = search.hypotheses(cloud.seen.texlets, cloud.around)
    found = found.at(in_images(cloud.seen, found, search))
    seed = zlib.crc32(cloud.seen.texlets.positions.numpy().tobytes())
    order = torch.randperm(len(found), generator=torch.Generator().manual_seed(seed))
    return Ranked(found.at(order), none := torch.zeros(len(found)), none)


def voted(proposer: Proposer, cloud: Cloud) -> Ranked:
    grasps = proposer.propose(cloud.seen.texlets, cloud.around)
    return Ranked(Hypotheses(grasps.T_object_tcp, grasps.grasp_type), grasps.probability, grasps.score)


def rank(who: Peers, sensed: Sequence[Sensed]) -> dict[str, list[Timed]]:
    """Method -> what it ranks for each cloud."""
    found: dict[str, list[Timed]] = {}
    with threads(1):
        for name, method in who.ours.items():
            method(sensed[0].cloud)  # compiled, and what is kept of a hand
            for each in sensed:
                start = time.process_time()
                ranks = method(each.cloud)
                found.setdefault(name, []).append(Timed(ranks, time.process_time() - start))
        if who.network is not None:
            found[NETWORK], found[FREE] = by_network(who.network, who.search, sensed)
    return found


def by_network(network: ContactGraspNet, search: Search, sensed: Sequence[Sensed]) -> tuple[list[Timed], list[Timed]]:
    """As the network ranks; and what is left of that in places that are free of all that is seen, as ours must be."""
    raw = [raw_cloud(each.obj, each.sensing, each.cloud, each.seed) for each in sensed]
    all_of_it, left = [], []
    for each, found in zip(sensed, network.grasps(raw, [each.seed for each in sensed]), strict=True):
        poses = Hypotheses(found.T, torch.full((len(found.T),), WIDE))
        start = time.process_time()
        free = search.free(poses.T, poses.grasp_type, each.cloud.seen.texlets.positions.float(), each.cloud.around)
        without = Ranked(poses.at(free), found.confidence[free], found.confidence[free])
        left.append(Timed(without, found.seconds + time.process_time() - start))
        all_of_it.append(Timed(Ranked(poses, found.confidence, found.confidence), found.seconds))
    return all_of_it, left
