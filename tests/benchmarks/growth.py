"""How time grows with points, particles, objects and cores.

    python tests/benchmarks/growth.py

Points: SPGF of more objects side by side. Particles: condensed by the neighbourhood analysis. Objects: described and
learned from (K = 20, two types of 500 grasps each). Cores: SPGF and trials with one and two of them. The exponent is
the slope of time over size in logarithms: 1 is linear.
"""

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import numpy as np
import torch
from shared.clouds import cloud, objects, sensed
from shared.harness import Report, take_turns, threads

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import learn
from spgf_torch.affordance.pairs import cell_pairs
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import spgf
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.paths import root
from spgf_torch.prototypes.kmeans import assign, kmeans_plusplus, lloyd
from spgf_torch.settings import settings
from spgf_torch.simulation.config import EpisodeConfig
from spgf_torch.simulation.execute import execute
from spgf_torch.simulation.table import read_table
from spgf_torch.simulation.worker import Trials

POINTS, OBJECTS, PARTICLES = (2_000, 8_000, 32_000), (2, 4, 8), (100_000, 400_000, 1_600_000)
TRIED = 150  # candidates of each of four objects
CONFIG, FEATURES = settings(AffordanceConfig), settings(FeatureConfig)


def grown(report: Report, what: str, seconds: dict[int, float]) -> None:
    """A row a size, and the exponent as a figure."""
    for size, value in seconds.items():
        report.row(what=what, size=size, seconds=value)
    exponent = np.polyfit(np.log(list(seconds)), np.log(list(seconds.values())), 1)[0]
    sizes = f"{min(seconds):,} to {max(seconds):,}"
    report.figure(f"growth of time with {what}, {sizes}: exponent", "", f"{exponent:.2f}")


def example(number: int, centres: torch.Tensor | None, most: int | None = None):
    """Pairs, ids and outcomes of one object; of the pairs the first `most`."""
    texlets = sensed(number)
    features = spgf(texlets.positions, texlets.normals, FEATURES)
    T, relations = features.T_object_feature[features.valid], features.relations()[features.valid]
    if centres is None:
        return relations
    table = read_table(root() / "data" / "trials" / f"{objects()[number].name}.parquet")
    rows = torch.cat([(table.grasp_type == code).nonzero()[:500, 0] for code in (0, 1)])
    pairs = cell_pairs(T, table.T_object_tcp[rows], table.grasp_type[rows], CONFIG, torch.Generator().manual_seed(0))
    if most is not None:
        pairs = type(pairs)(pairs.feature[:most], pairs.grasp[:most], pairs.cell[:most], pairs.grasp_type)
    return pairs, assign(relations, centres), table.success[rows]


def by_size(work, sizes: tuple[int, ...], rounds: int = 2) -> dict[int, float]:
    seconds = take_turns({str(size): lambda s=size: work(s) for size in sizes}, rounds)
    return {size: seconds[str(size)] for size in sizes}


def main() -> None:
    report = Report("growth", " ".join(__doc__.split("\n\n")[2].split()))
    report.devices()
    clouds = {size: cloud(size) for size in POINTS}
    relations = example(0, None)
    centres, _ = lloyd(relations, kmeans_plusplus(relations, 20, 1, torch.Generator().manual_seed(0))[0], 10, 1e-4)
    with threads(1):
        grown(report, "points (SPGF)", by_size(lambda size: spgf(*clouds[size], FEATURES), POINTS))
        examples = [example(i, centres) for i in range(max(OBJECTS))]
        held = [len(pairs.cell) for pairs, _, _ in examples]

        def condensed(size: int) -> None:
            share = size / sum(held)
            cut = [int(share * count) for count in held]
            parts = [
                (type(p)(p.feature[:n], p.grasp[:n], p.cell[:n], p.grasp_type), ids, success)
                for (p, ids, success), n in zip(examples, cut, strict=True)
            ]
            learn(parts, centres, CONFIG, types=2)

        sizes = tuple(size for size in PARTICLES if size <= sum(held))
        grown(report, "particles (neighbourhood analysis)", by_size(condensed, sizes))
        grown(
            report,
            "objects (described and learned from)",
            by_size(lambda size: learn([example(i, centres) for i in range(size)], centres, CONFIG, types=2), OBJECTS),
        )
    cores(report, clouds[max(POINTS)])
    report.write()


def cores(report: Report, texlets: tuple[torch.Tensor, torch.Tensor]) -> None:
    def described(count: int) -> None:
        with threads(count):
            spgf(*texlets, FEATURES)

    trials, requests = Trials(load_hand(settings(HandConfig)), settings(EpisodeConfig)), []
    for number in range(4):
        table = read_table(root() / "data" / "trials" / f"{objects()[number].name}.parquet")
        requests.append((objects()[number], "WPG", table.T_object_tcp[table.grasp_type == 1][:TRIED]))

    def executed(count: int) -> None:
        for _ in execute(requests, trials, workers=count):
            pass

    for what, work in (("SPGF", described), ("trials, starts of processes included", executed)):
        seconds = by_size(work, (1, 2))
        report.row(what=what, seconds_1_core=seconds[1], seconds_2_cores=seconds[2])
        report.figure(f"2 cores over 1: {what}", "", f"{seconds[1] / seconds[2]:.2f}x")


if __name__ == "__main__":
    main()
