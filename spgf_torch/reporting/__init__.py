"""The report over runs of `train`: the paper's Table 1, its Figures 1 to 13, and what a reader asks next.

`data` reads what runs left and decides what belongs together; `figures` are charts, pictures and 3-D views; `pages`
turn both into tables and one page. Nothing here learns or simulates. What `compare` shows, rows of
`conf/comparison` side by side, is `data.comparison`, `figures.comparison_chart` and `pages.comparison_text`.
"""
