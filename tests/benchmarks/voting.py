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
from functools import partial

import torch
from shared.clouds import objects, sensed
from shared.harness import Report, take_turns, threads
from torch import Tensor

from spgf_torch.affordance.lattice import Lattice
from spgf_torch.affordance.model import kernel_of, learn, vote
from spgf_torch.affordance.pairs import CellPairs, cell_pairs, lattice_of, points_of
from spgf_torch.affordance.particles import pairs_within
from spgf_torch.affordance.ranking import judge
from spgf_torch.affordance.voting import VotingIndex
from spgf_torch.config import AffordanceConfig, FeatureConfig, root, settings
from spgf_torch.features.spgf import spgf
from spgf_torch.prototypes.kmeans import assign, kmeans_plusplus, lloyd
from spgf_torch.trials.table import read_table

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


def brute_force(
    asked: tuple[Tensor, Tensor], pairs: Tensor, held: tuple[Tensor, ...], by_slice: list[Tensor]
) -> Tensor:
    """(P, 2) successes and particles around each pair: all particles of the slice, weighted by the kernel."""
    position, quaternion, success = held
    found = torch.zeros(len(pairs), 2)
    for i, slice_ in enumerate(pairs.tolist()):
        members = by_slice[slice_]
        apart = (position[members] - asked[0][i]).square().sum(1)
        angle = 2 * torch.acos((quaternion[members] @ asked[1][i]).abs().clamp_(max=1))
        sigma = math.radians(CONFIG.kernel_deg)
        weight = torch.exp(-apart / (2 * CONFIG.kernel**2) - angle.square() / (2 * sigma**2))
        found[i] = torch.stack([weight @ success, weight.sum()])
    return found


def main() -> None:
    report = Report("voting", " ".join(__doc__.split("\n\n")[2].split()))
    devices = report.devices()
    generator = torch.Generator().manual_seed(0)
    T, relations = described(0)
    centres = lloyd(relations, kmeans_plusplus(relations, K, 1, generator)[0], 20, 1e-4)
    rows = torch.arange(FEATURES) % len(T)  # an object with fewer features is asked some of them twice
    T, ids = T[rows], assign(relations[rows], centres)
    T_grasp, grasp_type, _ = tried(0)
    T_grasp, grasp_type = T_grasp[:CANDIDATES], grasp_type[:CANDIDATES]
    lattice: Lattice = lattice_of(CONFIG)
    kernel_of(CONFIG, "cpu")
    for size in SIZES:
        examples = particles(centres, size, generator)
        model = learn(examples, centres, CONFIG)
        index = {
            d: VotingIndex(
                learn([(on(p, d), i.to(d), s.to(d)) for p, i, s in examples], centres.to(d), CONFIG).condensed, lattice
            )
            for d in devices
        }

        def voted(device: str, index: dict[str, VotingIndex] = index) -> Tensor:
            pairs = cell_pairs(T.to(device), T_grasp.to(device), grasp_type.to(device), CONFIG)
            votes = vote(index[device], pairs, ids.to(device))
            free = torch.zeros_like(pairs.grasp_type, dtype=torch.bool)
            return judge(votes, index[device].condensed.base_rate, pairs.grasp_type, free, CONFIG).log_odds

        parts = [points_of(pairs, i) for pairs, i, _ in examples]
        position, quaternion = lattice.centres(torch.cat([part.cell for part in parts]).long())
        success = torch.cat([s[pairs.grasp.long()] for pairs, _, s in examples]).float()
        slices = torch.cat([part.slice for part in parts])
        columns = (position, quaternion, success)
        held = [tuple(column[slices == s].contiguous() for column in columns) for s in range(2 * K)]
        within = pairs_within(T, T_grasp, CONFIG.reach)
        chosen = torch.randperm(len(within.feature), generator=generator)[:SAMPLE]
        wanted = ids[within.feature[chosen]] * 2 + grasp_type[within.grasp[chosen]]
        asked = (within.position[chosen], within.quaternion[chosen])
        methods = {device: lambda d=device: voted(d) for device in devices}
        methods["brute force, sample"] = partial(brute_force, asked, wanted, held)
        methods["condense"] = partial(learn, examples, centres, CONFIG)
        with threads(2):
            seconds = take_turns(methods, rounds=3)
        brute = seconds["brute force, sample"] * len(within.feature) / SAMPLE
        times = brute / seconds["cpu"]
        report.row(
            particles=size,
            pairs_within_reach=len(within.feature),
            condensed_points=len(model.condensed.cell),
            **{f"seconds_{device}": seconds[device] for device in devices},
            seconds_condense=seconds["condense"],
            seconds_brute_force=brute,
            ratio=times,
        )
        limit = {100_000: "<= 1 s", 1_000_000: "<= 5 s, >= 50x"}.get(size, "")
        report.figure(
            f"voting, {FEATURES} features x {CANDIDATES} candidates x {size:,} particles, 2 threads",
            limit,
            f"{seconds['cpu']:.2f} s, {times:,.0f}x brute force (index once a model: {seconds['condense']:.2f} s)",
        )
    report.write()


def on(pairs: CellPairs, device: str) -> CellPairs:
    return CellPairs(*(getattr(pairs, name).to(device) for name in ("feature", "grasp", "cell", "grasp_type")))


if __name__ == "__main__":
    main()
