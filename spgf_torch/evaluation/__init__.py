"""Folds, success-rates, intervals, and the files and tables that show them (paper, section 4, Eq. 10, Table 1).

Pure functions on numbers: nothing here learns or simulates.
"""
