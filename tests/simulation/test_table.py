"""The trial table: round trip, what it refuses, and that reading it needs no simulator."""

from dataclasses import replace

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch

from spgf_torch.errors import InputError
from spgf_torch.evaluation.endings import ending_lines
from spgf_torch.simulation.causes import CAUSE_COLUMNS, Causes
from spgf_torch.simulation.label import Label
from spgf_torch.simulation.table import (
    KEY,
    OUTCOMES,
    Provenance,
    TrialTable,
    check_poses,
    read_table,
    read_tables,
    table_path,
    write_table,
)

TYPES = ("NPG", "WPG")
PROVENANCE = Provenance("mug", "d" * 64, "h" * 64, {"jitter": 0.005}, {"dt": 0.002, "friction": 0.6}, 3, 0)


@pytest.fixture
def table() -> TrialTable:
    generator = torch.Generator().manual_seed(0)
    return TrialTable(
        provenance=PROVENANCE,
        position=torch.randn(6, 3, generator=generator),
        quaternion=torch.nn.functional.normalize(torch.randn(6, 4, generator=generator)),
        grasp_type=torch.tensor([0, 0, 0, 1, 1, 1]),
        outcome=torch.tensor([0, 1, 2, 3, 4, 5]),
        versions={"sapien": "3.0.3"},
        grasp_types=TYPES,
    )


def test_round_trip_is_exact(tmp_path, table):
    path = table_path(tmp_path, "mug")
    write_table(path, table)
    got = read_table(path)
    assert got.provenance == table.provenance and got.versions == table.versions and got.object_name == "mug"
    for name in ("position", "quaternion", "grasp_type", "outcome", "T_object_tcp", "success"):
        assert torch.equal(getattr(got, name), getattr(table, name)), name
    assert got.success.tolist() == [True] + [False] * 5
    assert [file.name for file in tmp_path.iterdir()] == ["mug.parquet"]


def test_causes_of_a_robots_episode(tmp_path, table):
    """Columns beside the outcomes, exactly where the episode has a robot's settings."""
    path = table_path(tmp_path, "mug")
    write_table(path, table)
    assert pq.read_schema(path).names[-1] == "outcome" and read_table(path).causes is None
    labels = [
        Label("success", "held", force=12.5),
        Label("collision", "approach", "table"),
        Label("missed", "lift", "one_side", 0.0, "right"),
        Label("dropped", "shake", "none", 0.25, "left+right"),
        Label("slipped"),
        Label("rotated", "turn", "none", 3.0),
    ]
    robot = replace(PROVENANCE, episode={**PROVENANCE.episode, "robot": {"draw": 0}})
    write_table(path, replace(table, provenance=robot, causes=Causes.of(labels)))
    assert pq.read_schema(path).names[-4:] == list(CAUSE_COLUMNS)
    got = read_table(path)
    assert got.causes is not None and got.causes.fingers == ("", "left+right", "right")
    assert got.causes.labels([OUTCOMES[code] for code in got.outcome]) == labels
    assert ending_lines([got]) == [
        "why 5 of 6 trials failed: 1 collision (table); 1 dropped (shake, without left, right); 1 missed (one side); "
        "1 rotated (turn); 1 slipped",
        "held at the end by 12.5 N of the weakest finger (median), 5 % by less than 12.5 N",
    ]
    write_table(path, replace(table, causes=Causes.of(labels)))
    assert read_table(path).causes is None and ending_lines([table]) == []


def test_equal_tables_are_equal_files(tmp_path, table):
    first, second = tmp_path / "a", tmp_path / "b"
    write_table(first, table)
    write_table(second, table)
    assert first.read_bytes() == second.read_bytes()


def test_a_failed_write_leaves_the_old_table(tmp_path, table, monkeypatch):
    path = table_path(tmp_path, "mug")
    write_table(path, table)
    before = path.read_bytes()

    def full(*args, **kwargs):
        args[1].write(b"half")
        raise OSError("No space left on device")

    monkeypatch.setattr(pq, "write_table", full)
    with pytest.raises(OSError, match="No space"):
        write_table(path, table)
    assert path.read_bytes() == before and len(list(tmp_path.iterdir())) == 1


def test_missing_truncated_and_foreign_files(tmp_path, table):
    path = table_path(tmp_path, "mug")
    with pytest.raises(InputError, match=r"mug\.parquet: expected a trial table, got no such file"):
        read_table(path)
    write_table(path, table)
    whole = path.read_bytes()
    path.write_bytes(whole[:-200])
    with pytest.raises(InputError, match=r"mug\.parquet: expected a trial table as it was written, got a damaged"):
        read_table(path)
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"mug\.parquet: expected a trial table, got a damaged file"):
        read_table(path)
    pq.write_table(pa.table({"a": [1]}), path)
    with pytest.raises(InputError, match=r"mug\.parquet: expected a trial table of schema 1, got a foreign file"):
        read_table(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"hand_digest": "x" * 64},
            "expected trials made with hand_digest xxxxxxxxxxxx..., got hhhhhhhhhhhh...; "
            "another hand, or another URDF or description of it",
        ),
        ({"object_digest": "x" * 64}, "expected trials made with object_digest xxxxxxxxxxxx..., got dddddddddddd..."),
        ({"episode": {"dt": 0.002, "friction": 0.8}}, "expected trials made with episode.friction 0.8, got 0.6"),
        ({"sampler": {"jitter": 0.001}}, "expected trials made with sampler.jitter 0.001, got 0.005"),
        ({"seed": 1}, "expected trials made with seed 1, got 0"),
    ],
)
def test_tables_of_another_hand_object_or_setting_are_refused(tmp_path, table, change, message):
    write_table(table_path(tmp_path, "mug"), table)
    assert len(read_tables(tmp_path, [PROVENANCE], TYPES)) == 1
    with pytest.raises(InputError) as error:
        read_tables(tmp_path, [replace(PROVENANCE, **change)], TYPES)
    assert str(error.value).endswith("mug.parquet: " + message)


def rewritten(path, change):
    """The table with its columns changed and our metadata kept, but for the digest."""
    content = pq.read_table(path)
    pq.write_table(change(content).replace_schema_metadata({KEY: content.schema.metadata[KEY]}), path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.drop(["x"]), "expected the columns"),
        (lambda t: t.set_column(2, "x", pa.array(["far"] * len(t))), "expected the columns"),
        (lambda t: t.slice(0, 1), "expected 3 trials of each grasp type, got 1 of NPG$"),
        (lambda t: t.set_column(2, "x", pa.array([float("nan")] * len(t), pa.float32())), "finite poses"),
    ],
)
def test_damaged_content_is_refused(tmp_path, table, change, message):
    path = tmp_path / "mug.parquet"
    write_table(path, table)
    rewritten(path, change)
    with pytest.raises(InputError, match=message) as error:
        read_table(path)
    assert "mug.parquet" in str(error.value) and "\n" not in str(error.value)


def test_quaternions_may_be_a_thousandth_off(tmp_path):
    """Half a thousandth too long or too short is rounding, 1.5 thousandths of one row are not; no row is none."""
    position, unit = torch.zeros(3, 3), torch.tensor([0.6, 0.0, -0.8, 0.0])
    for scale in (1.0005, 0.9995):
        check_poses(tmp_path, position, torch.stack([unit, unit * scale, unit]))
    for scale, length in ((1.0015, "1 to 1.00"), (0.9985, "0.9985 to 1$")):
        with pytest.raises(InputError, match=rf"expected quaternions of length 1, got {length}"):
            check_poses(tmp_path, position, torch.stack([unit, unit, unit * scale]))
    check_poses(tmp_path, position[:0], unit[None][:0])
    for bad in (torch.inf, torch.nan):
        with pytest.raises(InputError, match="finite poses"):
            check_poses(tmp_path, torch.full((3, 3), bad), unit.repeat(3, 1))


def test_a_table_of_three_types_comes_back(tmp_path, table):
    """Two candidates of each of claw, hook and pinch; the words are sorted, whatever the order of the rows."""
    types = ("claw", "hook", "pinch")
    made = replace(
        table,
        provenance=replace(PROVENANCE, candidates=2),
        grasp_type=torch.tensor([2, 0, 1, 1, 0, 2]),
        grasp_types=types,
    )
    write_table(table_path(tmp_path, "mug"), made)
    (got,) = read_tables(tmp_path, [made.provenance], types)
    assert got.grasp_types == types and got.grasp_type.tolist() == [2, 0, 1, 1, 0, 2]
    with pytest.raises(
        InputError, match=r"mug.parquet: expected trials of the hand's grasp types NPG, WPG; got claw, "
    ):
        read_tables(tmp_path, [made.provenance], TYPES)


def test_each_type_has_its_candidates(tmp_path, table):
    """Three of each are said; two NPG and four WPG are six, too, but not three of each."""
    path = table_path(tmp_path, "mug")
    write_table(path, replace(table, grasp_type=torch.tensor([0, 1, 0, 1, 1, 1])))
    with pytest.raises(InputError, match="expected 3 trials of each grasp type, got 2 of NPG, 4 of WPG"):
        read_table(path)
