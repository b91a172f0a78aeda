"""The report over runs of `train`: the paper's Table 1, its Figures 9 to 13, and what a reader asks next.

Reads what runs left (`runs`, `predictions`), decides what belongs together (`sweep`), and turns it into tables
(`table1`, `ablations`), pictures (`charts`, `scenes`), 3-D views (`views`) and one page (`page`). Nothing here learns
or simulates. `comparison` is what `compare` shows: rows of `conf/comparison` side by side.
"""
