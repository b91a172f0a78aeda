"""Makes `tests/` importable: what test files of several rooms share stands in `doors.py`."""
