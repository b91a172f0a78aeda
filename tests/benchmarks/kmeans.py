"""Prototypes against scikit-learn's KMeans(n_init=10) and MiniBatchKMeans: inertia and seconds on one thread.

    python tests/benchmarks/kmeans.py [K ...]

Data: the SPGF features of four fifths of the shipped objects, as a fold of the cross-validation learns from. The three
take turns in one run, a seed a round; medians over rounds, ratios ours / theirs. ARI: adjusted Rand index between
the clusterings of each method's seeds.
"""

import statistics
import sys
import time
from collections.abc import Callable
from itertools import combinations

import numpy as np
import torch
from sklearn.cluster import KMeans, MiniBatchKMeans
from sklearn.metrics import adjusted_rand_score
from threadpoolctl import threadpool_limits

from spgf_torch.config import FeatureConfig, PrototypeConfig, SensingConfig, root, settings
from spgf_torch.features.spgf import spgf
from spgf_torch.objects.library import load_objects
from spgf_torch.prototypes.kmeans import assign, inertia
from spgf_torch.prototypes.module import fit_prototypes
from spgf_torch.sensing.sense import sense

ROUNDS = 3


def features() -> torch.Tensor:
    objects = [obj for i, obj in enumerate(load_objects(root() / "data" / "objects")) if i % 5]
    found = []
    for obj in objects:
        texlets = sense(obj, settings(SensingConfig), 0)
        described = spgf(texlets.positions, texlets.normals, settings(FeatureConfig))
        found.append(described.relations()[described.valid])
    return torch.cat(found)


def methods(relations: torch.Tensor, K: int) -> dict[str, Callable[[int], torch.Tensor]]:
    table, config = relations.numpy(), settings(PrototypeConfig, num_clusters=K)

    def fitted(model: KMeans | MiniBatchKMeans) -> torch.Tensor:
        return torch.from_numpy(np.asarray(model.fit(table).cluster_centers_))

    return {
        "ours": lambda seed: fit_prototypes(relations, config, seed),
        "KMeans(n_init=10)": lambda seed: fitted(KMeans(K, n_init=10, random_state=seed)),
        "MiniBatchKMeans": lambda seed: fitted(MiniBatchKMeans(K, random_state=seed)),
    }


def compare(relations: torch.Tensor, K: int) -> None:
    runs: dict[str, list[tuple[float, float, torch.Tensor]]] = {}
    for seed in range(ROUNDS):
        for name, fit in methods(relations, K).items():
            start = time.perf_counter()
            centres = fit(seed)
            seconds = time.perf_counter() - start
            runs.setdefault(name, []).append((inertia(relations, centres), seconds, assign(relations, centres)))
    print(f"\nK = {K}, {len(relations)} x {relations.shape[1]} features, {ROUNDS} rounds")
    for name, results in runs.items():
        inertias, times = [r[0] for r in results], [r[1] for r in results]
        ratios = [ours[0] / theirs for ours, theirs in zip(runs["ours"], inertias, strict=True)]
        faster = statistics.median(times) / statistics.median(r[1] for r in runs["ours"])
        agreement = [adjusted_rand_score(a[2], b[2]) for a, b in combinations(results, 2)]
        print(
            f"{name:18} inertia {statistics.median(inertias):9.0f}   ours/theirs {min(ratios):.4f} to {max(ratios):.4f}"
            f"   {statistics.median(times):6.2f} s   theirs/ours {faster:5.2f}   ARI {min(agreement):.2f}"
        )


if __name__ == "__main__":
    torch.set_num_threads(1)
    data = features()
    with threadpool_limits(1):
        fit_prototypes(data[:1000], settings(PrototypeConfig, num_clusters=2), 0)  # warm up
        for clusters in [int(word) for word in sys.argv[1:]] or [20]:
            compare(data, clusters)
