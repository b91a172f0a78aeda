"""A single changed bit in whatever is read again is refused in one line that names the file."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import flips
import pytest
from flips import ROOT, accepted, kinds, sums_accepted

import spgf_torch.files.digests as sealing
from spgf_torch.affordance.model import load_model
from spgf_torch.errors import InputError
from spgf_torch.files.digests import BLANK, KEY, MARK, SUMS, check_seal, sealed, sealed_json
from spgf_torch.simulation.table import read_table

NAMES = (
    "model.safetensors",
    "model.json",
    "predictions.parquet",
    "results.json",
    "config.yaml of a run",
    "per_object.csv",
    "trial table",
    "trial table as committed",
    "config.yaml as committed",
    "config.yaml of trials",
    "manifest.json",
    "best.ckpt",
    "judged.safetensors",
    "card.json",
    "file of a data set",
    "objects.json",
)


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> dict[str, flips.Kind]:
    made = kinds(tmp_path_factory.mktemp("kinds"))
    assert tuple(made) == NAMES
    for kind in made.values():
        kind.read()
    return made


@pytest.mark.parametrize("name", NAMES)
def test_a_changed_bit(name: str, known: dict[str, flips.Kind]) -> None:
    assert not list(accepted(known[name], 40))


@pytest.mark.parametrize("name", NAMES)
def test_a_changed_bit_in_the_first_and_last_bytes(name: str, known: dict[str, flips.Kind]) -> None:
    assert not list(accepted(known[name], 20, seed=1, most=200))


@pytest.mark.parametrize("name", ["model.json", "trial table", "predictions.parquet", "best.ckpt"])
def test_every_bit_of_a_seal(name: str, known: dict[str, flips.Kind]) -> None:
    path = known[name].path
    whole = path.read_bytes()
    start = whole.index(MARK)
    for bit in range(8 * (start - 8), 8 * (start + len(BLANK) + 2)):
        changed = bytearray(whole)
        if bit // 8 < len(whole):
            changed[bit // 8] ^= 1 << bit % 8
            path.write_bytes(changed)
            with pytest.raises(InputError):
                check_seal(path, "a file")
    path.write_bytes(whole)


def test_every_bit_of_a_list_of_digests(tmp_path: Path) -> None:
    for name in ("apple.parquet", SUMS):
        shutil.copy(ROOT / "data/trials" / name, tmp_path)
    assert not sums_accepted(tmp_path)


def test_the_committed_tables_are_all_listed() -> None:
    listed = sealing.sums_of(ROOT / "data/trials" / SUMS)
    assert listed is not None
    names = {path.name for path in (ROOT / "data/trials").iterdir() if path.name != SUMS}
    assert set(listed) == names and len(names) == 51


@pytest.mark.parametrize("change", ["reordered", "spaced", "a value", "a key more", "without its seal"])
def test_settings_of_a_model_that_were_edited(change: str, known: dict[str, flips.Kind], tmp_path: Path) -> None:
    model = Path(shutil.copytree(known["model.json"].path.parent, tmp_path / "model"))
    path = model / "model.json"
    content = json.loads(path.read_text())
    if change == "a value":
        content["settings"]["sensing"]["cameras"] += 1
    elif change == "a key more":
        content["note"] = "mine"
    elif change == "without its seal":
        del content[KEY], content["tensors_sha256"]
    path.write_text(json.dumps(content, sort_keys=change != "reordered", indent=4 if change == "spaced" else 1))
    with pytest.raises(InputError, match=r"model\.(json|safetensors): expected"):
        load_model(model)


def test_a_pair_that_does_not_belong_together(known: dict[str, flips.Kind], tmp_path: Path) -> None:
    """What a call leaves that is killed between its two files."""
    model = Path(shutil.copytree(known["model.json"].path.parent, tmp_path / "model"))
    before = (model / "model.json").read_bytes()
    flips.save_model(flips.tiny_model(4, flips.train_config(4)), model)
    load_model(model)
    (model / "model.json").write_bytes(before)
    with pytest.raises(InputError, match=r"model\.safetensors: expected the tensors that model\.json"):
        load_model(model)


def test_files_without_a_digest_are_read_with_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "trials").mkdir()
    for name in ("apple", "egg", "pear"):
        shutil.copy(ROOT / f"data/trials/{name}.parquet", tmp_path / "trials")
        read_table(tmp_path / f"trials/{name}.parquet")
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1 and "apple.parquet" in told[0] and "no digest" in told[0]


def with_sums(text: str) -> Callable[[Path], object]:
    return lambda path: (path.parent / SUMS).write_text(text)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (with_sums(""), "a SHA-256"),
        (with_sums("\n"), "a SHA-256"),
        (with_sums("0" * 64 + "  other\n"), "missing in it"),
        (with_sums("0" * 64 + "  file\n"), "damaged or edited"),
        (with_sums("0" * 63 + "  file\n"), "a SHA-256"),
        (with_sums("0" * 64 + "  file\n" + "0" * 64 + "  file\n"), "twice"),
        (with_sums("0" * 64 + "  ../file\n"), "a SHA-256"),
        (with_sums("SHA256 (file) = " + "0" * 64 + "\n"), "a SHA-256"),
        (lambda path: (path.parent / SUMS).write_bytes(b"\xff\xfe"), "digests"),
        (lambda path: path.write_bytes(sealed(BLANK) + sealed(BLANK)), "damaged or edited"),
        (lambda path: path.write_bytes(sealed(BLANK)[:-1]), "damaged or edited"),
        (lambda path: path.write_bytes(BLANK), "damaged or edited"),
        (lambda path: path.write_bytes(MARK), "damaged or edited"),
        (lambda path: path.write_bytes(sealed(b"a" * 3_000_000 + BLANK)[1:]), "damaged or edited"),
        (lambda path: path.write_bytes(sealed_json({"a": 1}) + b" "), "damaged or edited"),
        (lambda path: path.write_bytes(b""), "empty"),
        (lambda path: (path.unlink(), path.mkdir()), "directory"),
    ],
)
def test_odd_digests(change: Callable[[Path], object], words: str, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("content")
    change(path)
    with pytest.raises(InputError, match=f"expected.*got.*{words}|{words}") as refused:
        check_seal(path, "a file")
    assert "\n" not in str(refused.value)


def test_seals_stand_at_either_end_of_large_files(tmp_path: Path) -> None:
    path, much = tmp_path / "file", b"x" * 3_000_000
    for content in (BLANK + much, much + BLANK):
        path.write_bytes(sealed(content))
        assert check_seal(path, "a file")
