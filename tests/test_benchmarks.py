"""The committed results of the benchmarks: whole, without paths, and shown by the table writer."""

import importlib.util
import json
import re
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parent / "benchmarks"
RESULTS = sorted((BENCHMARKS / "results").glob("*.json"))


@pytest.mark.parametrize("path", RESULTS, ids=lambda path: path.stem)
def test_results_say_what_where_and_on_what(path):
    content = json.loads(path.read_text())
    assert (BENCHMARKS / f"{path.stem}.py").is_file()
    assert content["command"].startswith(f"python tests/benchmarks/{path.stem}.py")
    assert content["machine"]["processor"] and content["machine"]["cores"] and content["machine"]["packages"]["torch"]
    assert content["figures"] and content["rows"]
    assert not re.search(r"(^|[\s\"'=])/\w+/", path.read_text())  # a path of the machine


def test_the_table_has_a_line_a_figure():
    spec = importlib.util.spec_from_file_location("table", BENCHMARKS / "shared" / "table.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    lines = module.table().splitlines()
    figures = [figure["figure"] for path in RESULTS for figure in json.loads(path.read_text())["figures"]]
    assert [line.split(" | ")[0].removeprefix("| ") for line in lines[2 : 2 + len(figures)]] == figures
