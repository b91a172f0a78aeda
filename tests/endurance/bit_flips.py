"""python tests/endurance/bit_flips.py [FLIPS]: single changed bits in every kind of file that is read again.

Of each kind FLIPS random bits (300 if not given) are changed, one at a time; prints a table of how many were refused in
one line that names the file. Exit status 1 where one was not.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "hostile"))
from flips import accepted, kinds


def main() -> int:
    count, missed = int(sys.argv[1]) if len(sys.argv) > 1 else 300, 0
    with tempfile.TemporaryDirectory() as folder:
        for name, kind in kinds(Path(folder)).items():
            found = list(accepted(kind, count, seed=7))
            missed += len(found)
            print(f"{name:26} {kind.path.stat().st_size:8d} bytes {count - len(found):5d} of {count} refused")
            for line in found:
                print(f"    {line}")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
