"""Prototypes against scikit-learn's MiniBatchKMeans and KMeans(n_init=10) and faiss's Kmeans: inertia and seconds.

    python tests/benchmarks/kmeans.py [K ...]

Data: the SPGF features of four fifths of the shipped objects, as a fold of the cross-validation learns from. All take
turns in one run, a seed a round; medians over rounds; on one thread, and those that take less than a second on two as
well. ARI: adjusted Rand index between the clusterings of each method's seeds.
"""

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import statistics
import sys
import time
from collections.abc import Callable
from itertools import combinations

import numpy as np
import torch
from shared.clouds import objects, sensed
from shared.harness import Report, threads

from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import spgf
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.prototypes.kmeans import assign, inertia
from spgf_torch.prototypes.lightning_module import fit_prototypes
from spgf_torch.settings import settings

ROUNDS = 5
SLOW = ("KMeans(n_init=10)", "faiss Kmeans(nredo=10)")


def features() -> torch.Tensor:
    found = []
    for number in range(len(objects())):
        if number % 5:
            texlets = sensed(number)
            described = spgf(texlets.positions, texlets.normals, settings(FeatureConfig))
            found.append(described.relations()[described.valid])
    return torch.cat(found)


def methods(relations: torch.Tensor, K: int, report: Report) -> dict[str, Callable[[int], torch.Tensor]]:
    table, config = relations.numpy(), settings(PrototypeConfig, num_clusters=K)
    found: dict[str, Callable[[int], torch.Tensor]] = {
        "ours": lambda seed: fit_prototypes(relations, config, seed),
    }
    if sklearn := report.peer("sklearn.cluster", "scikit-learn"):

        def fitted(model) -> torch.Tensor:
            return torch.from_numpy(np.asarray(model.fit(table).cluster_centers_))

        found["KMeans(n_init=10)"] = lambda seed: fitted(sklearn.KMeans(K, n_init=10, random_state=seed))
        found["MiniBatchKMeans"] = lambda seed: fitted(sklearn.MiniBatchKMeans(K, random_state=seed))
        found["MiniBatchKMeans(n_init=10)"] = lambda seed: fitted(
            sklearn.MiniBatchKMeans(K, n_init=10, random_state=seed)
        )
    if faiss := report.peer("faiss", "faiss-cpu"):

        def by_faiss(seed: int) -> torch.Tensor:
            model = faiss.Kmeans(table.shape[1], K, niter=100, nredo=10, seed=seed + 1, max_points_per_centroid=10**9)
            model.train(table)
            return torch.from_numpy(model.centroids.copy())

        found["faiss Kmeans(nredo=10)"] = by_faiss
    return found


def compare(report: Report, relations: torch.Tensor, K: int, count: int) -> None:
    from sklearn.metrics import adjusted_rand_score

    runs: dict[str, list[tuple[float, float, torch.Tensor]]] = {}
    fits = {name: fit for name, fit in methods(relations, K, report).items() if count == 1 or name not in SLOW}
    for seed in range(ROUNDS):
        for name, fit in fits.items():
            start = time.perf_counter()
            centres = fit(seed)
            seconds = time.perf_counter() - start
            runs.setdefault(name, []).append((inertia(relations, centres), seconds, assign(relations, centres)))
    medians = {name: [statistics.median(r[i] for r in results) for i in (0, 1)] for name, results in runs.items()}
    for name, results in runs.items():
        agreement = [adjusted_rand_score(a[2], b[2]) for a, b in combinations(results, 2)]
        report.row(
            K=K,
            threads=count,
            features=len(relations),
            method=name,
            inertia_ours_over_theirs=medians["ours"][0] / medians[name][0],
            seconds=medians[name][1],
            seconds_theirs_over_ours=medians[name][1] / medians["ours"][1],
            least_ARI=min(agreement),
        )
    for name in [name for name in fits if name != "ours"]:
        lower, faster = medians["ours"][0] / medians[name][0], medians[name][1] / medians["ours"][1]
        asked = {"KMeans(n_init=10)": "inertia <= 1", "MiniBatchKMeans": "speed >= 1"}.get(name, "")
        report.figure(
            f"k-means, K = {K}, threads {count}: inertia ours / theirs, speed ours over theirs: {name}",
            asked,
            f"{lower:.3f}, {faster:.2f}",
        )


if __name__ == "__main__":
    found = Report("kmeans", "Inertia ours / theirs and speed theirs / ours, SPGF features of 40 objects.")
    found.devices()
    data = features()
    fit_prototypes(data[:1000], settings(PrototypeConfig, num_clusters=2), 0)  # warm up
    for clusters in [int(word) for word in sys.argv[1:]] or [20]:
        for count in (1, 2):
            with threads(count):
                compare(found, data, clusters, count)
    found.write()
