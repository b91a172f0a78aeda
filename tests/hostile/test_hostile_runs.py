"""Folders of runs whose files are damaged, foreign or made to hurt: the report leaves each out and says why."""

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

sys.path.append(str(Path(__file__).parents[1] / "reporting"))
from report_runs import write_run

from spgf_torch.config import InputError
from spgf_torch.reporting.runs import load_runs, read_per_object

Change = Callable[[Any], Any]


def without(*keys: str) -> Change:
    """A document less the key that the keys lead to."""

    def change(document: Any) -> Any:
        inner = document
        for key in keys[:-1]:
            inner = inner[key]
        del inner[keys[-1]]
        return document

    return change


def put(value: Any, *keys: str) -> Change:
    def change(document: Any) -> Any:
        inner = document
        for key in keys[:-1]:
            inner = inner[key]
        inner[keys[-1]] = value
        return document

    return change


RESULTS: dict[str, Change] = {
    "a list": lambda document: [document],
    "a number": lambda document: 7,
    "nothing": lambda document: None,
    "newer": put(99, "schema"),
    "K in words": put("twenty", "K"),
    "N not there": without("N"),
    "seed a list": put([1], "seed"),
    "no rankings": without("by_ranking"),
    "rankings a list": put([], "by_ranking"),
    "a ranking a word": put("good", "by_ranking", "log_odds"),
    "no rates over all": without("by_ranking", "log_odds", "all"),
    "a rate in words": put("high", "by_ranking", "log_odds", "all", "NPG"),
    "a type not there": without("by_ranking", "log_odds", "all", "CG"),
    "intervals not there": without("interval95_by_ranking"),
    "an interval of one end": put([0.5], "interval95_by_ranking", "log_odds", "all", "NPG"),
    "an interval a number": put(0.5, "interval95_by_ranking", "log_odds", "all", "NPG"),
    "ceiling a list": put([1, 2], "ceiling"),
    "random not there": without("random"),
    "chosen by name": put({"first": "log_odds"}, "chosen"),
    "calibration in words": put({"NPG": {"slope": "steep"}}, "calibration"),
}
SETTINGS: dict[str, Change] = {
    "a list": lambda document: [document],
    "nothing": lambda document: None,
    "no hand": without("hand"),
    "hand a word": put("sdh2", "hand"),
    "no openings": without("hand", "openings"),
    "openings a list": put([], "hand", "openings"),
    "no objects": without("objects"),
    "objects a number": put(5, "objects"),
    "no sensing": without("sensing"),
    "features a word": put("spgf", "features"),
}
RAW = {
    "empty": b"",
    "no text": b"\xff\xfe\x00\x01",
    "zeros": b"\0" * 4096,
    "half of it": b'{"schema": 1, "by_rank',
    "NaN for a name": b"{NaN: 1}",
    "deep": b"[" * 50_000,
    "a tag that would run code": b"!!python/object/apply:os.system ['touch ran']",
    "an anchor bomb": b"a: &a [x,x,x,x,x,x,x,x,x]\n"
    + b"".join(b"%c: &%c [*%c,*%c,*%c,*%c,*%c,*%c,*%c,*%c,*%c]\n" % (n, n, *[n - 1] * 9) for n in range(98, 110)),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("whole") / "2026-01-01_00-00-00_K3", model=False)


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "runs" / whole.name))


def left_out(run: Path, file: str) -> str:
    """The line that the report says of the run; nothing else is left of it, and no file made."""
    before, lines = sorted(Path().rglob("*")), []
    with pytest.raises(InputError, match="at least one finished run"):
        load_runs(str(run.parent), lines.append, pictured=True)
    assert sorted(Path().rglob("*")) == before
    assert len(lines) == 1 and "\n" not in lines[0] and len(lines[0]) < 500
    assert lines[0].startswith("left out: ") and file in lines[0] and "expected" in lines[0] and "got" in lines[0]
    return lines[0]


@pytest.mark.parametrize("name", RESULTS)
def test_damaged_results(run: Path, name: str) -> None:
    path = run / "results.json"
    path.write_text(json.dumps(RESULTS[name](json.loads(path.read_text()))))
    left_out(run, "results.json")


@pytest.mark.parametrize("name", SETTINGS)
def test_damaged_settings(run: Path, name: str) -> None:
    path = run / "config.yaml"
    path.write_text(yaml.safe_dump(SETTINGS[name](yaml.safe_load(path.read_text()))))
    left_out(run, "config.yaml")


@pytest.mark.parametrize("file", ["results.json", "config.yaml"])
@pytest.mark.parametrize("name", RAW)
def test_damaged_bytes(run: Path, name: str, file: str) -> None:
    (run / file).write_bytes(RAW[name])
    left_out(run, file)


@pytest.mark.parametrize(
    "content",
    [
        *RAW.values(),
        b"object,class\nmug,containers\n",
        b"object,class,fold,log_odds_NPG\nmug,containers,one,0.5\n",
        b"object,class,fold,log_odds_NPG,log_odds_WPG,log_odds_CG\nmug,vessels,1,0.5,0.5,0.5\n",
        b"x" * 200_000,
    ],
)
def test_damaged_rates_of_objects(run: Path, content: bytes) -> None:
    (loaded,) = load_runs(str(run), lambda line: None)
    (run / "per_object.csv").write_bytes(content)
    with pytest.raises(InputError) as refused:
        read_per_object(loaded)
    line = str(refused.value)
    assert "per_object.csv" in line and "expected" in line and "got" in line and "\n" not in line and len(line) < 500
