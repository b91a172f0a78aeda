"""Running many trials: independent of workers and order, and the committed table can be had again."""

import random
import weakref
from pathlib import Path

import pytest
import torch
from trial_objects import box, can, cup

from spgf_torch.paths import root
from spgf_torch.settings import settings
from spgf_torch.simulation.config import SamplerConfig
from spgf_torch.simulation.execute import CHUNK, execute, provenance_of, sample, simulate
from spgf_torch.simulation.table import OUTCOMES, read_table, table_path, write_table

COMMITTED = root() / "data" / "trials"


def test_workers_and_order_do_not_matter(trials, tmp_path: Path):
    """Two workers over two objects, then each object alone in this process: the same rows, the same file."""
    objects, sampler, told = [can(), box((0.04, 0.06, 0.1))], settings(SamplerConfig), []
    together = list(simulate(objects, trials, sampler, 12, 0, 2, lambda name, done: told.append((name, done))))
    assert told == [("can", 12)] * 2 + [("box", 12)] * 2
    for obj, table in zip(reversed(objects), reversed(together), strict=True):
        (alone,) = simulate([obj], trials, sampler, 12, 0, workers=1)
        assert table.provenance == alone.provenance == provenance_of(obj, trials, sampler, 12, 0)
        assert torch.equal(table.position, alone.position) and torch.equal(table.outcome, alone.outcome)
        assert {0, 1} <= set(table.outcome.tolist())
        write_table(tmp_path / "a", table)
        write_table(tmp_path / "b", alone)
        assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_sampling_leaves_no_scene_of_rays(trials):
    """A process has room for a thousand; objects stay."""
    obj, sampler = box((0.04, 0.06, 0.1)), settings(SamplerConfig)
    scene = weakref.ref(obj.mesh.ray)
    assert len(sample(obj, provenance_of(obj, trials, sampler, 5, 0), {"NPG": "surface_pairs"})) == 5
    assert scene() is None


def test_stored_poses_end_as_they_did(trials):
    (table,) = simulate([cup()], trials, settings(SamplerConfig), 30, 1, workers=1)
    requests = [
        (cup(), kind, table.T_object_tcp[table.grasp_type == code]) for code, kind in enumerate(table.grasp_types)
    ]
    assert torch.equal(torch.cat(list(execute(requests, trials, workers=1))), table.outcome)


def test_requests_of_any_length_come_back_in_order(trials):
    """None, more than a chunk, one: far from the object, so that every trial but the last ends at the pre-check."""
    away = torch.eye(4).repeat(CHUNK + 3, 1, 1)
    requests = [(can(), "NPG", away[:0]), (can(), "NPG", away), (can(), "WPG", away[:0]), (can(), "WPG", away[:1])]
    assert [len(outcome) for outcome in execute(requests, trials, workers=1)] == [0, CHUNK + 3, 0, 1]


@pytest.mark.skipif(not any(COMMITTED.glob("*.parquet")), reason="no committed trial table")
def test_committed_trials_can_be_had_again(trials):
    """36 committed trials of objects drawn by lot, two in three of them free of collision, end as the table says."""
    from spgf_torch.objects.library import load_objects

    lot = random.Random(0)
    requests, expected = [], []
    for obj in lot.sample(load_objects(root() / "data" / "objects"), 6):
        table = read_table(table_path(COMMITTED, obj.name))
        assert table.provenance.object_digest == obj.digest and table.provenance.hand_digest == trials.hand.digest
        free = (table.outcome != OUTCOMES.index("collision")).nonzero()[:, 0].tolist()
        for row in lot.sample(free, 4) + lot.sample(range(len(table)), 2):
            requests.append((obj, table.grasp_types[table.grasp_type[row]], table.T_object_tcp[row : row + 1]))
            expected.append(int(table.outcome[row]))
    assert torch.cat(list(execute(requests, trials, workers=1))).tolist() == expected
