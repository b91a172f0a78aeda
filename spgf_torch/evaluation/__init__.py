"""Folds, predictions, success-rates, intervals, and the files and tables of them (paper, section 4, Eq. 10, Table 1).

Nothing here learns or simulates.
"""
