"""Folders of runs whose files are damaged, foreign or made to hurt: the report leaves each out and says why."""

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

sys.path.append(str(Path(__file__).parents[1] / "reporting"))
from report_runs import rewritten, write_run

from spgf_torch.errors import InputError
from spgf_torch.files.digests import KEY, sealed_json
from spgf_torch.reporting.data.predictions import predictions_of
from spgf_torch.reporting.data.runs import Notes, load_runs, read_per_object

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
    "K of infinity": put(float("inf"), "K"),
    "K of NaN": put(float("nan"), "K"),
    "K null": put(None, "K"),
    "K true": put(True, "K"),
    "K a fraction": put(20.5, "K"),
    "K below 0": put(-1, "K"),
    "K of 400 digits": put(10**400, "K"),
    "N of infinity": put(float("-inf"), "N"),
    "N a word": put("10", "N"),
    "N null": put(None, "N"),
    "seed of infinity": put(float("inf"), "seed"),
    "schema true": put(True, "schema"),
    "schema null": put(None, "schema"),
    "success_rate null": put(None, "success_rate"),
    "success_rate a number": put(0.5, "success_rate"),
    "success_rate a list": put([], "success_rate"),
    "success_rate of no class": put({}, "success_rate"),
    "a rate of NaN": put(float("nan"), "by_ranking", "log_odds", "all", "NPG"),
    "a rate of infinity": put(float("inf"), "by_ranking", "log_odds", "all", "CG"),
    "a rate above 1": put(1.5, "by_ranking", "log_odds", "all", "NPG"),
    "a rate below 0": put(-0.5, "by_ranking", "log_odds", "all", "NPG"),
    "a rate null": put(None, "by_ranking", "log_odds", "all", "NPG"),
    "a rate true": put(True, "by_ranking", "log_odds", "all", "NPG"),
    "a rate of 400 digits": put(10**400, "by_ranking", "log_odds", "all", "NPG"),
    "a rate a list": put([0.5], "by_ranking", "log_odds", "all", "NPG"),
    "an interval of NaN": put([float("nan")] * 2, "interval95_by_ranking", "log_odds", "all", "NPG"),
    "an interval of three": put([0.1, 0.2, 0.3], "interval95_by_ranking", "log_odds", "all", "NPG"),
    "an interval null": put(None, "interval95_by_ranking", "log_odds", "all", "NPG"),
    "intervals null": put(None, "interval95_by_ranking"),
    "rankings null": put(None, "by_ranking"),
    "a ranking with an escape": lambda document: {
        **document,
        **{
            key: {**document[key], "\x1b[2J": document[key]["log_odds"]}
            for key in ("by_ranking", "interval95_by_ranking")
        },
    },
    "random null": put(None, "random"),
    "random of NaN": put(float("nan"), "random", "all", "NPG"),
    "random without a class": without("random", "all"),
    "random without a type": without("random", "all", "NPG"),
    "ceiling null": put(None, "ceiling"),
    "ceiling of infinity": put(float("inf"), "ceiling", "all", "NPG"),
    "ceiling without a type": without("ceiling", "all", "CG"),
    "chosen null": put(None, "chosen"),
    "chosen a list": put(["log_odds"], "chosen"),
    "chosen with an escape": put({"0": "\x1b]0;title\x07"}, "chosen"),
    "chosen a number": put({"0": 3}, "chosen"),
    "calibration null": put(None, "calibration"),
    "calibration of NaN": put({"NPG": {"ece": float("nan")}}, "calibration"),
    "seconds null": put(None, "seconds"),
    "seconds of infinity": put({"voting": float("inf")}, "seconds"),
    "seconds in words": put({"voting": "long"}, "seconds"),
    "costs a list": put([1], "costs"),
    "costs below 0": put({"model_bytes": -5}, "costs"),
    "from_cache in words": put({"features": "all"}, "from_cache"),
    "files null": put(None, "files"),
    "files in a list": put(["config.yaml"], "files"),
    "files of another digest": put({"per_object.csv": "0" * 64, "config.yaml": "x"}, "files"),
}
SETTINGS: dict[str, Change] = {
    "a list": lambda document: [document],
    "nothing": lambda document: None,
    "no hand": without("hand"),
    "hand a word": put("sdh2", "hand"),
    "no preshapes": without("hand", "preshapes"),
    "preshapes a list": put([], "hand", "preshapes"),
    "no objects": without("objects"),
    "objects a number": put(5, "objects"),
    "no sensing": without("sensing"),
    "features a word": put("spgf", "features"),
    "objects null": put(None, "objects"),
    "hand null": put(None, "hand"),
    "preshapes null": put(None, "hand", "preshapes"),
    "the hand of an earlier version": put({"name": "sdh2", "openings": {"NPG": 0.045, "WPG": 0.095}}, "hand"),
    "an opening in words": put("wide", "hand", "preshapes", "NPG", "opening"),
    "an opening of NaN": put(float("nan"), "hand", "preshapes", "NPG", "opening"),
    "an opening of infinity": put(float("inf"), "hand", "preshapes", "WPG", "opening"),
    "a preshape not there": without("hand", "preshapes", "WPG"),
    "an opening of a kilometre": put(1000.0, "hand", "preshapes", "WPG", "opening"),
    "an opening below 0": put(-0.1, "hand", "preshapes", "WPG", "opening"),
    "an opening a list": put([0.1], "hand", "preshapes", "WPG", "opening"),
    "sensing null": put(None, "sensing"),
    "sensing a list": put([], "sensing"),
    "features null": put(None, "features"),
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
    """With a digest that is right, so that the values themselves are refused."""
    path = run / "results.json"
    document = json.loads(path.read_text())
    del document[KEY]
    document = RESULTS[name](document)
    path.write_bytes(sealed_json(document) if isinstance(document, dict) else json.dumps(document).encode())
    line = left_out(run, "config.yaml" if name == "files of another digest" else "results.json")
    assert "SHA-256" not in line


@pytest.mark.parametrize("name", SETTINGS)
def test_damaged_settings(run: Path, name: str) -> None:
    path = run / "config.yaml"
    path.write_text(yaml.safe_dump(SETTINGS[name](yaml.safe_load(path.read_text()))))
    assert "written with" in left_out(run, "config.yaml")
    rewritten(run, lambda content: None)
    assert "written with" not in left_out(run, "config.yaml")


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


def column(name: str, value: object, rows: slice = slice(3, 4)) -> Callable[[pa.Table], pa.Table]:
    """The predictions with another value in some rows of a column."""

    def change(table: pa.Table) -> pa.Table:
        values = np.array(table[name].to_pylist(), dtype=object)
        values[rows] = value
        return table.set_column(table.column_names.index(name), name, pa.array(list(values)))

    return change


EVERY = slice(None)
PREDICTIONS: dict[str, Callable[[pa.Table], pa.Table]] = {
    "an escape in an object": column("object", "\x1b[2Jmug", EVERY),
    "an object of two lines": column("object", "mu\ng", EVERY),
    "an object that climbs": column("object", "../../mug", EVERY),
    "an object of markup": column("object", "<script>", EVERY),
    "an object null": column("object", None, EVERY),
    "an unknown class": column("class", "bowls", EVERY),
    "an escape in a class": column("class", "\x1b]0;a\x07", EVERY),
    "an unknown type": column("type", "ABC"),
    "a probability of NaN": column("probability", float("nan")),
    "a probability above 1": column("probability", 1.5),
    "a probability below 0": column("probability_before", -0.5),
    "a probability null": column("probability", None),
    "a position of infinity": column("px", float("inf")),
    "a position of NaN": column("pz", float("nan")),
    "quaternions of 0": lambda table: column("qw", 0.0)(column("qx", 0.0)(column("qy", 0.0)(column("qz", 0.0)(table)))),
    "a score of NaN": column("score_log_odds", float("nan")),
    "no scores": lambda table: table.drop_columns([n for n in table.column_names if n.startswith("score_")]),
    "no votes": lambda table: table.drop_columns("votes"),
    "no row": lambda table: table.slice(0, 0),
    "a hundred columns": lambda table: pa.table({f"c{i}": [0] for i in range(100)}),
    "positions in words": column("px", "far", EVERY),
    "folds in words": column("fold", "first", EVERY),
    "folds null": column("fold", None, EVERY),
}


@pytest.mark.parametrize("name", PREDICTIONS)
def test_damaged_predictions(run: Path, name: str) -> None:
    (loaded,) = load_runs(str(run), lambda line: None)
    path = run / "predictions.parquet"
    predictions_of(loaded, "log_odds")
    pq.write_table(PREDICTIONS[name](pq.read_table(path)).replace_schema_metadata(None), path)
    with pytest.raises(InputError) as refused:
        predictions_of(loaded, "log_odds")
    line = str(refused.value)
    assert line.startswith(str(path)) and "expected" in line and line.isprintable() and len(line) < 600, line


def test_damaged_runs_do_not_end_a_report(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each is told in a line without a control character; the others are reported on."""
    for number, change in enumerate(RESULTS.values()):
        run = Path(shutil.copytree(whole, tmp_path / f"runs/\x1b[2J{number}"))
        document = change(json.loads((run / "results.json").read_text()))
        (run / "results.json").write_text(json.dumps(document))
    shutil.copytree(whole, tmp_path / "runs" / whole.name)
    notes = Notes()
    (loaded,) = load_runs(str(tmp_path / "runs"), notes, pictured=True)
    assert loaded.folder.name == whole.name and len(notes.lines) == len(RESULTS)
    assert all(line.isprintable() for line in [*notes.lines, *capsys.readouterr().err.splitlines()])
