"""Trial tables and models that are damaged, foreign, of other versions, or made to hurt."""

import json
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from hostile import ROOT, Case, Write, as_json, model_document, nothing, raw, refused, table
from safetensors.torch import save_file

from spgf_torch.affordance.calibration import NUMBERS
from spgf_torch.files.digests import BLANK
from spgf_torch.simulation.table import KEY

OBJECTS = ("apple", "box_tea", "egg", "mug_coffee")
FIRST = "trials/apple.parquet"


@cache
def apple() -> pa.Table:
    return pq.read_table(ROOT / "data/trials/apple.parquet")


def about(**changes: Any) -> dict[str, Any]:
    return {**json.loads(apple().schema.metadata[KEY]), **changes}


def origin(**changes: Any) -> dict[str, Any]:
    return about(origin={**about()["origin"], **changes})


def parquet(change: Callable[[pa.Table], pa.Table] = lambda made: made, notes: object = None, **how: Any) -> Write:
    def write(path: Path) -> None:
        made = change(apple())
        text = json.dumps(about() if notes is None else notes) if not isinstance(notes, bytes) else notes
        pq.write_table(made.replace_schema_metadata({KEY: text}), path, **how)

    return write


def column(name: str, values: Any) -> Callable[[pa.Table], pa.Table]:
    def change(made: pa.Table) -> pa.Table:
        new = values(len(made))
        new = new if isinstance(new, pa.Array) else pa.array(new)
        return made.set_column(made.column_names.index(name), name, new)

    return change


def one_word(count: int) -> pa.DictionaryArray:
    """A word of a megabyte in every row, stored once."""
    return pa.DictionaryArray.from_arrays(np.zeros(count, np.int8), pa.array(["A" * 10**6]))


def types(*words: str | None) -> Callable[[pa.Table], pa.Table]:
    """The table with other words for its two types, a thousand rows each."""
    return lambda made: made.set_column(1, "type", pa.array(np.repeat(np.array(words, dtype=object), 1000)))


def lists(count: int) -> pa.ListArray:
    """A thousand zeros in every row."""
    return pa.ListArray.from_arrays(np.arange(count + 1, dtype=np.int32) * 1000, np.zeros(count * 1000, np.int8))


def rows_of_zeros(count: int) -> Write:
    """Few bytes, many rows."""

    def write(path: Path) -> None:
        with pq.ParquetWriter(path, pa.schema([("x", pa.int8())], metadata={KEY: json.dumps(about())})) as writer:
            for _ in range(count // 10_000_000):
                writer.write_table(pa.table({"x": np.zeros(10_000_000, np.int8)}), row_group_size=10_000_000)

    return write


def cut(share: float) -> Write:
    return lambda path: (parquet()(path), path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)]))


def flipped(path: Path) -> None:
    """Bytes of the data pages turned round; the footer stays."""
    parquet()(path)
    content = bytearray(path.read_bytes())
    for at in range(100, len(content) - 6000, 7):
        content[at] ^= 0xFF
    path.write_bytes(bytes(content))


TABLES: list[tuple[str, Write, str]] = [
    ("missing", lambda path: path.unlink(), "simulate"),
    ("empty", raw(b""), "empty"),
    ("bytes", raw(bytes(range(256))), "damaged"),
    ("half", cut(0.5), "damaged"),
    ("without its end", cut(0.99), "damaged"),
    ("damaged within", flipped, ""),
    ("a folder", lambda path: (path.unlink(), path.mkdir()), "no such file"),
    ("of nobody", lambda path: pq.write_table(apple().replace_schema_metadata(None), path), "foreign"),
    ("of schema 0", parquet(notes=about(schema=0)), "schema"),
    ("of a schema to come", parquet(notes=about(schema=99)), "99"),
    ("of a schema in words", parquet(notes=about(schema=["1"])), "schema"),
    ("about itself no JSON", parquet(notes=b"{"), "trial table"),
    ("about itself a list", parquet(notes=[]), "columns"),
    ("about itself brackets", parquet(notes=b"[" * 100_000), "trial table"),
    ("without an origin", parquet(notes=about(origin=None)), "columns"),
    ("of an older origin", parquet(notes=about(origin={"object_name": "apple"})), "columns"),
    ("of an origin to come", parquet(notes=origin(gravity=9.81)), "columns"),
    ("without versions", parquet(notes={k: v for k, v in about().items() if k != "versions"}), "columns"),
    ("of another object", parquet(notes=origin(object_name="egg")), "object_name"),
    ("of a name that climbs", parquet(notes=origin(object_name="../../apple")), "object_name"),
    ("of a name of two lines", parquet(notes=origin(object_name="ap\nple\x1b[2J")), "object_name"),
    ("of a name of a megabyte", parquet(notes=origin(object_name="a" * 10**6)), "object_name"),
    ("of another shape", parquet(notes=origin(object_digest="0" * 64)), "object_digest"),
    ("of another hand", parquet(notes=origin(hand_digest="0" * 64)), "hand_digest"),
    ("of another seed", parquet(notes=origin(seed=7)), "seed"),
    ("of candidates in words", parquet(notes=origin(candidates="many")), "trials"),
    ("of a trillion candidates", parquet(notes=origin(candidates=10**12)), "trials"),
    ("with rows missing", parquet(lambda made: made.slice(0, 100)), "1000 trials of each"),
    ("without rows", parquet(lambda made: made.slice(0, 0)), "1000 trials of each"),
    ("of one type alone", parquet(lambda made: made.slice(0, 1000)), "grasp types NPG, WPG; got NPG"),
    ("of other types", parquet(types("NPG", "grip")), "grasp types NPG, WPG; got NPG, grip"),
    ("of types null", parquet(types("NPG", None)), "type"),
    ("without x", parquet(lambda made: made.drop_columns("x")), "columns"),
    ("without outcomes", parquet(lambda made: made.drop_columns("outcome")), "columns"),
    ("with x twice", parquet(lambda made: made.append_column("x", made["x"])), "columns"),
    ("with x in words", parquet(column("x", lambda n: ["a"] * n)), "columns"),
    ("with x of lists", parquet(column("x", lists)), "one value a row"),
    ("with x of nulls", parquet(column("x", lambda n: [None] * n)), ""),
    ("with x of NaN", parquet(column("x", lambda n: np.full(n, np.nan))), "finite"),
    ("with quaternions of 0", parquet(lambda m: column("qw", np.zeros)(column("qx", np.zeros)(m))), "length 1"),
    ("with quaternions too long", parquet(column("qw", lambda n: np.full(n, 2.0))), "length 1"),
    ("with an unknown outcome", parquet(column("outcome", lambda n: ["exploded"] * n)), "exploded"),
    ("with outcomes of numbers", parquet(column("outcome", np.arange)), "outcome"),
    ("with an unknown type", parquet(column("type", lambda n: ["ABC"] * n)), "ABC"),
    ("with a type of a megabyte", parquet(column("type", one_word)), "letters"),
    ("with words of 12 MB", parquet(column("type", lambda n: ["NPG" * 2_000] * n), use_dictionary=False), ""),
    ("with thirty million rows", rows_of_zeros(30_000_000), "at most"),
    ("an arrow file", lambda path: pa.ipc.new_file(path, apple().schema).close(), "damaged"),
]  # fmt: skip
BESIDE: list[tuple[str, Write, str]] = [
    ("no settings", lambda path: path.unlink(), "simulate"),
    ("settings without keys", raw(b"a: 1\n"), "candidates and seed"),
    ("settings in words", raw(b"candidates: many\nseed: 0\n"), "candidates and seed"),
    ("settings of infinity", raw(b"candidates: .inf\nseed: 0\n"), "candidates and seed"),
    ("settings that read the environment", raw(b"candidates: ${oc.env:HOME}\nseed: 0\n"), "candidates and seed"),
    ("settings that make an object", raw(b"candidates: !!python/object/apply:os.getpid []\n"), "config.yaml"),
    ("settings that are a list", raw(b"- 1\n"), "candidates and seed"),
    ("settings of brackets", raw(b"[" * 50_000), "config.yaml"),
]
TRIALS = [Case(f"trials {name}", {}, write, (word,)) for name, write, word in TABLES]
TRIALS += [Case(name, {"file": "trials/config.yaml"}, write, (word,)) for name, write, word in BESIDE]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("small")
    for kind, suffix in (("objects", "yaml"), ("trials", "parquet")):
        (folder / kind).mkdir()
        for name in OBJECTS:
            shutil.copy(ROOT / f"data/{kind}/{name}.{suffix}", folder / kind)
    shutil.copy(ROOT / "data/trials/config.yaml", folder / "trials")
    return folder


@table(TRIALS)
def test_trials(case: Case, small: Path, described: None, capsys: pytest.CaptureFixture) -> None:
    shutil.copytree(small / "trials", "trials")
    file = case.changes.get("file", FIRST)
    case.write(Path(file))
    given = {"objects": str(small / "objects"), "trials": "trials", "cache": "off"}
    refused("train", given, (file, *case.words, "expected", "got"), capsys)


@pytest.fixture
def described(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The objects are read once."""
    from spgf_torch.objects import folders

    known = _objects(small / "objects")
    monkeypatch.setattr(folders, "read_objects", lambda *_: known)


@cache
def _objects(folder: Path) -> Any:
    from spgf_torch.objects.folders import Objects
    from spgf_torch.objects.library import load_objects

    return Objects(load_objects(folder), [], [])


@cache
def tensors() -> dict[str, torch.Tensor]:
    """A model of three prototypes and two points."""
    return {
        "centres": torch.rand(3, 144),
        "calibration": torch.zeros(2, len(NUMBERS)),
        "slice_start": torch.tensor([0, 1, 1, 1, 1, 1, 2]),
        "cell": torch.tensor([5, 7], dtype=torch.int32),
        "probability": torch.tensor([0.5, 0.25]),
        "support": torch.tensor([3.0, 4.0]),
        "base_rate": torch.tensor([0.5, 0.5]),
    }


def safe(**changes: torch.Tensor | None) -> Write:
    def write(path: Path) -> None:
        kept = {**tensors(), **changes}
        save_file({name: value for name, value in kept.items() if value is not None}, path)

    return write


def header(text: bytes, length: int | None = None) -> Write:
    return raw((len(text) if length is None else length).to_bytes(8, "little") + text)


def entry(dtype: str = "F32", shape: list[int] | None = None, offsets: list[int] | None = None) -> bytes:
    about = {"dtype": dtype, "shape": shape or [1], "data_offsets": offsets or [0, 4]}
    return json.dumps({"centres": about}).encode()


TENSORS: list[tuple[str, Write, str]] = [
    ("missing", nothing, "no such file"),
    ("empty", raw(b""), "safetensors"),
    ("bytes", raw(bytes(range(256))), "safetensors"),
    ("a pickle", lambda path: torch.save({"centres": torch.zeros(1)}, path), "safetensors"),
    ("half", lambda path: (safe()(path), path.write_bytes(path.read_bytes()[:300])), "safetensors"),
    ("a header of a trillion bytes", header(b"{}", 10**12), "safetensors"),
    ("a header of brackets", header(b"[" * 100_000), "safetensors"),
    ("a header that is none", header(b"hello"), "safetensors"),
    ("a header of two megabytes", header(b"{" + b" " * 2_000_000 + b"}"), "header"),
    ("a header of 200,000 tensors", header(json.dumps({f"t{i}": {} for i in range(200_000)}).encode()), "header"),
    ("a header longer than the file", header(b"{}", 900_000), "safetensors"),
    ("a length alone", raw((8).to_bytes(8, "little")), "safetensors"),
    ("a mark of a seal", lambda path: save_file(tensors(), path, {"seal": "spgf-sha256"}), "damaged"),
    ("the seal of another file", lambda path: save_file(tensors(), path, {"seal": BLANK.decode()}), "damaged"),
    ("a tensor of a trillion numbers", header(entry(shape=[10**12], offsets=[0, 4 * 10**12])), "safetensors"),
    ("offsets below 0", header(entry(offsets=[-4, 0])), "safetensors"),
    ("offsets outside", header(entry(offsets=[100, 104])), "safetensors"),
    ("an unknown type", header(entry(dtype="Q99") + b""), "safetensors"),
    ("no tensor", lambda path: save_file({}, path), "missing"),
    ("without centres", safe(centres=None), "centres"),
    ("without a slice", safe(slice_start=torch.tensor([0, 2])), "slice_start"),
    ("centres in a row", safe(centres=torch.rand(3)), "centres"),
    ("no centre", safe(centres=torch.rand(0, 144)), "centres"),
    ("centres of another descriptor", safe(centres=torch.rand(3, 33)), "(K, 144)"),
    ("a centre alone", safe(centres=torch.tensor(3.0)), "centres"),
    ("centres of NaN", safe(centres=torch.full((3, 144), float("nan"))), "finite"),
    ("whole centres", safe(centres=torch.zeros(3, 144, dtype=torch.int8)), "centres"),
    ("cells of fractions", safe(cell=torch.tensor([0.5, 1.5])), "cell"),
    ("cells below 0", safe(cell=torch.tensor([-5, 7])), "cell"),
    ("cells beyond the lattice", safe(cell=torch.tensor([5, 2**60])), "cell"),
    ("slices that fall", safe(slice_start=torch.tensor([0, 2, 1, 1, 1, 1, 2])), "slice_start"),
    ("slices from 1", safe(slice_start=torch.tensor([1, 1, 1, 1, 1, 1, 2])), "slice_start"),
    ("slices beyond the points", safe(slice_start=torch.tensor([0, 1, 1, 1, 1, 1, 10**12])), "shape"),
    ("probabilities above 1", safe(probability=torch.tensor([0.5, 1.5])), "probability"),
    ("infinite support", safe(support=torch.tensor([3.0, float("inf")])), "support"),
    ("one base rate", safe(base_rate=torch.tensor([0.5])), "base_rate"),
    ("calibration of NaN", safe(calibration=torch.full((2, len(NUMBERS)), float("nan"))), "calibration"),
    ("complex numbers", safe(support=torch.zeros(2, dtype=torch.complex64)), "support"),
]


def document(change: Callable[[dict], Any]) -> Write:
    def write(path: Path) -> None:
        made = json.loads(json.dumps(model_document()))
        made = change(made) or made
        path.write_text(json.dumps(made))

    return write


def room(name: str, /, **changes: Any) -> Write:
    return document(lambda made: made["settings"][name].update(changes))


SETTINGS: list[tuple[str, Write, str]] = [
    ("missing", nothing, "no such file"),
    ("no JSON", raw(b"{hello"), "JSON"),
    ("a list", as_json([]), "format"),
    ("bytes", raw(bytes(range(128, 256))), "JSON"),
    ("brackets", raw(b"[" * 200_000), "JSON"),
    ("a number of 5000 digits", raw(b'{"format": ' + b"9" * 5000 + b"}"), "JSON"),
    ("20 MB", raw(b" " * 20_000_000), "bytes"),
    ("another format", document(lambda m: {**m, "format": "graspnet"}), "format"),
    ("an older schema", document(lambda m: {**m, "schema": 1}), "schema"),
    ("a schema to come", document(lambda m: {**m, "schema": 99}), "schema"),
    ("no settings", document(lambda m: {**m, "settings": {}}), "settings"),
    ("settings of a list", document(lambda m: {**m, "settings": []}), "settings"),
    ("another lattice", document(lambda m: m["lattice"].update(voxel=0.001)), "lattice"),
    ("a lattice in words", document(lambda m: m["lattice"].update(voxel="small")), "lattice"),
    ("a lattice too fine", room("affordance", voxel=0.001, rotation_deg=5.0), "cells"),
    ("an unknown key", room("features", _target_="os.system"), "_target_"),
    ("a key less", document(lambda m: m["settings"]["features"].pop("radius") and None), "radius"),
    ("a radius of words", room("features", radius="wide"), "radius"),
    ("a radius of NaN", room("features", radius=float("nan")), "radius"),
    ("no grasp types", document(lambda m: m.pop("grasp_types") and None), "grasp_types"),
    ("grasp types of another hand", document(lambda m: {**m, "grasp_types": ["WPG", "NPG"]}), "grasp_types"),
    ("100,000 grasp types", document(lambda m: {**m, "grasp_types": ["A"] * 10**5}), "grasp_types"),
    ("the environment", room("hand", name="${oc.env:HOME}"), "plain"),
    ("a room of a number", document(lambda m: m["settings"].update(sensing=3)), "sensing"),
    ("the seal of another file", document(lambda m: {**m, "seal": BLANK.decode()}), "damaged"),
    ("the digest of other tensors", document(lambda m: {**m, "tensors_sha256": "0" * 64}), ""),
    ("a digest of a number", document(lambda m: {**m, "tensors_sha256": 7}), ""),
    ("fingers of words", room("hand", fingers=["a", "b"]), "fingers"),
]
FILES = [("model.safetensors", *listed) for listed in TENSORS] + [("model.json", *listed) for listed in SETTINGS]
MODELS = [Case(f"{file}: {name}", {"file": file}, write, (word,)) for file, name, write, word in FILES]


@table(MODELS)
def test_models(case: Case, small: Path, described: None, capsys: pytest.CaptureFixture) -> None:
    Path("model").mkdir()
    files = {"model.json": as_json(model_document()), "model.safetensors": safe(), case.changes["file"]: case.write}
    for file, write in files.items():
        write(Path("model", file))
    given = {"objects": str(small / "objects"), "model": "model", "cache": "off"}
    refused("evaluate", given, (case.changes["file"], *case.words, "expected"), capsys)
