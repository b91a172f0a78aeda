"""Makes `tests/` importable: what test files of several sub-packages share stands beside this file."""
