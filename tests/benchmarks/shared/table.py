"""The figures of all benchmarks as a Markdown table for docs/benchmarks.md: python tests/benchmarks/shared/table.py"""

import json
from pathlib import Path

RESULTS = Path(__file__).parents[1] / "results"


def table(results: Path = RESULTS) -> str:
    """One line a figure, and below the table the machine and what was skipped."""
    found = {path.stem: json.loads(path.read_text()) for path in sorted(results.glob("*.json"))}
    lines = ["| figure | asked | measured | `tests/benchmarks/` |", "|---|---|---|---|"]
    for name, content in found.items():
        lines += [f"| {f['figure']} | {f['asked']} | {f['measured']} | `{name}.py` |" for f in content["figures"]]
    machines = {f"{m['processor']}, {m['cores']} cores" for m in (c["machine"] for c in found.values())}
    loads = sorted(content["machine"]["load"] for content in found.values())
    lines += ["", f"{'; '.join(sorted(machines))}; load while measuring {loads[0]} to {loads[-1]}." if loads else ""]
    skipped = sorted({line for content in found.values() for line in content["skipped"]})
    lines += [f"Skipped: {'; '.join(skipped)}."] if skipped else []
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
