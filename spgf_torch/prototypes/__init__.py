"""Prototypes: the K recurring local shapes, by k-means of the relational parts (paper, sections 3.2 and 3.3).

`kmeans` holds the pure steps (their arithmetic is in `spgf_torch.ops`), `kmeans_search` finds a start near the global
optimum, `lightning_module` fits in Lightning (and is the only one to import it).
"""
