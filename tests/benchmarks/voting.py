"""Voting against brute force over the particles, with 10,000, 100,000 and 1,000,000 of them.

    python tests/benchmarks/voting.py

Particles: the shipped objects' features (all texlets) paired with their grasps in data/trials, K = 20. Question: 1500
features of another object and 2000 candidate grasps. Voting: pairs within reach, their cells, votes, rankings; to
condense the particles into the index is done once a model, and timed beside it. Brute force: of every pair
within reach, the particles of its prototype and type, each with its distance in translation and rotation under the same
Gaussian kernel; timed on some of the pairs, drawn at random, and scaled to all.
"""

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import math
from dataclasses import dataclass
from functools import partial

import torch
from shared.clouds import objects, sensed
from shared.harness import Report, processor, take_turns, threads
from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import learn, vote
from spgf_torch.affordance.pairs import CellPairs, cell_pairs, grid_of, shape_grasp_particles
from spgf_torch.affordance.ranking import score_grasps
from spgf_torch.affordance.voting import VotingIndex
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import spgf
from spgf_torch.geometry import se3
from spgf_torch.paths import root
from spgf_torch.prototypes.kmeans import assign, kmeans_plusplus, lloyd
from spgf_torch.settings import settings
from spgf_torch.simulation.table import read_table

SIZES = (10_000, 100_000, 1_000_000)
FEATURES, CANDIDATES, K = 1500, 2000, 20
SAMPLE = 400  # pairs that brute force is timed on
CONFIG = settings(AffordanceConfig)


def described(number: int) -> tuple[Tensor, Tensor]:
    """Poses and relations of an object's features."""
    texlets = sensed(number)
    features = spgf(texlets.positions, texlets.normals, settings(FeatureConfig))
    return features.T_object_feature[features.valid], features.relations()[features.valid]


def tried(number: int) -> tuple[Tensor, Tensor, Tensor]:
    table = read_table(root() / "data" / "trials" / f"{objects()[number].name}.parquet")
    return table.T_object_tcp, table.grasp_type, table.success


def particles(centres: Tensor, wanted: int, generator: torch.Generator) -> list[tuple[CellPairs, Tensor, Tensor]]:
    """Pairs, ids and outcomes of as many objects as it takes; of the last one some pairs, drawn at random."""
    found: list[tuple[CellPairs, Tensor, Tensor]] = []
    missing, number = wanted, 1
    while missing:
        T, relations = described(number)
        T_grasp, grasp_type, success = tried(number)
        pairs = cell_pairs(T, T_grasp, grasp_type, CONFIG, generator)
        drawn = torch.randperm(len(pairs.cell), generator=generator)[:missing].sort().values
        pairs = CellPairs(pairs.feature[drawn], pairs.grasp[drawn], pairs.cell[drawn], grasp_type)
        found.append((pairs, assign(relations, centres), success))
        missing -= len(drawn)
        number += 1
    return found


def brute_force(asked: tuple[Tensor, Tensor], partitions: Tensor, held: list[tuple[Tensor, ...]]) -> Tensor:
    """(P, 2) successes and particles around each pair: all particles of its partition, weighted by the kernel."""
    found, sigma = torch.zeros(len(partitions), 2), math.radians(CONFIG.kernel_deg)
    for i, partition in enumerate(partitions.tolist()):
        position, quaternion, success = held[partition]
        apart = (position - asked[0][i]).square().sum(1)
        angle = 2 * torch.acos((quaternion @ asked[1][i]).abs().clamp_(max=1))
        weight = torch.exp(-apart / (2 * CONFIG.kernel**2) - angle.square() / (2 * sigma**2))
        found[i] = torch.stack([weight @ success, weight.sum()])
    return found


@dataclass(frozen=True)
class Question:
    """Features, poses (F, 4, 4) and prototypes (F,), that vote on grasps (G, 4, 4) of types (G,)."""

    T: Tensor
    ids: Tensor
    T_grasp: Tensor
    grasp_type: Tensor

    def answered(self, index: VotingIndex, device: str) -> Tensor:
        """(G,) scores, from poses to ranking."""
        grasp_type = self.grasp_type.to(device)
        pairs = cell_pairs(self.T.to(device), self.T_grasp.to(device), grasp_type, CONFIG)
        votes, free = vote(index, pairs, self.ids.to(device)), torch.zeros_like(grasp_type, dtype=torch.bool)
        return score_grasps(votes, index.condensed.base_rate, grasp_type, free, CONFIG).log_odds


def question(centres: Tensor) -> Question:
    """1500 features of the first object and its 2000 candidates; with fewer features it is asked some of them twice."""
    T, relations = described(0)
    rows = torch.arange(FEATURES) % len(T)
    T_grasp, grasp_type, _ = tried(0)
    return Question(T[rows], assign(relations[rows], centres), T_grasp[:CANDIDATES], grasp_type[:CANDIDATES])


def by_partition(examples: list[tuple[CellPairs, Tensor, Tensor]]) -> list[tuple[Tensor, ...]]:
    """Position, quaternion and success of the particles of each prototype and type."""
    parts = [shape_grasp_particles(pairs, ids, 2) for pairs, ids, _ in examples]
    position, quaternion = grid_of(CONFIG).centres(torch.cat([part.cell for part in parts]).long())
    success = torch.cat([success[pairs.grasp.long()] for pairs, _, success in examples]).float()
    partitions = torch.cat([part.partition for part in parts])
    return [tuple(c[partitions == s].contiguous() for c in (position, quaternion, success)) for s in range(2 * K)]


def compare(report: Report, size: int, asked: Question, centres: Tensor, devices: list[str]) -> None:
    generator = torch.Generator().manual_seed(size)
    examples = particles(centres, size, generator)
    methods = {"condense": partial(learn, examples, centres, CONFIG, types=2)}
    for device in devices:
        there = [(on(pairs, device), ids.to(device), success.to(device)) for pairs, ids, success in examples]
        index = VotingIndex(learn(there, centres.to(device), CONFIG, types=2).condensed, grid_of(CONFIG))
        methods[device] = partial(asked.answered, index, device)
    distance = torch.cdist(se3.position_of(asked.T), se3.position_of(asked.T_grasp))
    within = (distance <= CONFIG.reach).nonzero()
    feature, grasp = within[torch.randperm(len(within), generator=generator)[:SAMPLE]].unbind(1)
    partitions, T = (
        asked.ids[feature] * 2 + asked.grasp_type[grasp],
        se3.inverse(asked.T[feature]) @ asked.T_grasp[grasp],
    )
    poses = (se3.position_of(T), se3.quaternion_of(T))
    methods["brute force"] = partial(brute_force, poses, partitions, by_partition(examples))
    with threads(2):
        seconds = take_turns(methods, rounds=3)
        busy = processor(methods["cpu"])
    seconds["brute force"] *= len(within) / SAMPLE
    times = seconds["brute force"] / seconds["cpu"]
    words = {f"seconds_{name.replace(' ', '_')}": value for name, value in seconds.items()}
    report.row(particles=size, pairs_within_reach=len(within), **words, seconds_of_processor=busy, ratio=times)
    report.figure(
        f"voting, {FEATURES} features x {CANDIDATES} candidates x {size:,} particles, 2 threads",
        {100_000: "<= 1 s", 1_000_000: "<= 5 s, >= 50x"}.get(size, ""),
        f"{seconds['cpu']:.2f} s (of processor: {busy:.2f} s), "
        f"{times:,.0f}x brute force (index once a model: {seconds['condense']:.2f} s)",
    )


def main() -> None:
    report = Report("voting", " ".join(__doc__.split("\n\n")[2].split()))
    devices = report.devices()
    relations = described(0)[1]
    centres = kmeans_plusplus(relations, K, 1, torch.Generator().manual_seed(0))[0]
    centres, _ = lloyd(relations, centres, 20, 1e-4)
    asked = question(centres)
    for size in SIZES:
        compare(report, size, asked, centres, devices)
    report.write()


def on(pairs: CellPairs, device: str) -> CellPairs:
    return CellPairs(*(getattr(pairs, name).to(device) for name in ("feature", "grasp", "cell", "grasp_type")))


if __name__ == "__main__":
    main()
