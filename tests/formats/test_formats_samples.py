"""Training samples: what is in a cloud, and that strangers can stream the shards."""

import io
import json
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import webdataset
from small_trials import T_OBJECT_TCP, nothing, refusal, small_trials

from spgf_torch.errors import InputError
from spgf_torch.formats import tar
from spgf_torch.formats.config import SamplesConfig
from spgf_torch.formats.samples import grasp_clouds, read_samples, write_samples
from spgf_torch.formats.trial_sets import TrialSet

SETTINGS = SamplesConfig(points=40, radius=0.05, per_shard=3)


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> TrialSet:
    return small_trials(tmp_path_factory.mktemp("claw") / "claw")


@pytest.fixture(scope="module")
def shards(trials: TrialSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("out") / "samples"
    write_samples(folder, trials, SETTINGS, 0, nothing)
    return folder


def test_a_point_in_the_frame_of_its_grasp() -> None:
    """30 mm along the approach (s, 0, c), 20 mm along closing (0, 1, 0), 10 mm along y = (-c, 0, s) of the TCP."""
    c, s = np.sqrt(3) / 2, 0.5
    point = np.array([0.1, 0.2, 0.3]) + 0.03 * np.array([s, 0, c]) + [0, 0.02, 0] + 0.01 * np.array([-c, 0, s])
    clouds = grasp_clouds(point[None].astype(np.float32), T_OBJECT_TCP[None], SETTINGS, np.random.default_rng(0))
    assert clouds.shape == (1, 40, 3) and clouds.dtype == np.float32
    np.testing.assert_allclose(clouds[0], np.tile([0.02, 0.01, 0.03], (40, 1)), atol=1e-6)


def test_clouds_hold_points_of_the_ball_each_once() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.1, 0.1, (500, 3)).astype(np.float32)
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, :3, 3] = [[0, 0, 0], [0.1, 0.1, 0.1], [5, 0, 0]]
    for cloud, pose in zip(grasp_clouds(points, T, SETTINGS, rng), T, strict=True):
        distance = np.linalg.norm(points - pose[:3, 3], axis=1)
        inside = points[distance <= SETTINGS.radius]
        if not len(inside):
            inside = points[[distance.argmin()]]  # far from everything: the nearest point
        found = {tuple(row) for row in (cloud + pose[:3, 3]).round(5)}
        assert found <= {tuple(row) for row in inside.astype(float).round(5)}
        assert len(found) == min(len(inside), SETTINGS.points)
        counts = np.unique(cloud, axis=0, return_counts=True)[1]
        assert counts.max() - counts.min() <= 1  # repeated in turn


def test_near_points_are_likelier() -> None:
    """At 2 and at 4 cm: of one point drawn, the nearer four times as often."""
    points = np.array([[0.02, 0, 0], [0, 0.04, 0]], dtype=np.float32)
    one = SamplesConfig(points=1, radius=0.05, per_shard=1)
    clouds = grasp_clouds(points, np.tile(np.eye(4), (4000, 1, 1)), one, np.random.default_rng(2))
    assert (clouds[:, 0, 0] > 0.01).mean() == pytest.approx(0.8, abs=0.03)


def test_every_trial_is_one_sample_of_its_fold(trials: TrialSet, shards: Path) -> None:
    assert sorted(path.name for path in shards.iterdir()) == [f"fold{f}-00{n}.tar" for f in (0, 1) for n in (0, 1)]
    found = [sample for path in sorted(shards.iterdir()) for sample in read_samples(path)]
    names = {"box_a": 0, "cup_b": 1}
    expected = {(name, row) for name in names for row in range(4)}
    assert {(sample.object, sample.index) for sample in found} == expected and len(found) == 8
    for sample in found:
        assert sample.fold == names[sample.object] and sample.key == f"{sample.object}_{sample.type}_{sample.index}"
        assert sample.type == ("NPG", "NPG", "WPG", "WPG")[sample.index]
        assert sample.label == (1, 0, 0, 1)[sample.index] == int(sample.outcome == "success")
        assert sample.category == {"box_a": "boxes", "cup_b": "containers"}[sample.object]
        T = trials.tables[names[sample.object]].T_object_tcp[sample.index].numpy()
        back = sample.cloud @ T[:3, :3].T + T[:3, 3]
        seen = trials.texlets[names[sample.object]].positions.numpy()
        gaps = np.linalg.norm(back[:, None] - seen[None], axis=2).min(axis=1)
        assert gaps.max() < 1e-6  # m: in the object's frame they are sensed points again


def test_the_same_settings_give_the_same_bytes(trials: TrialSet, shards: Path, tmp_path: Path) -> None:
    write_samples(tmp_path / "again", trials, SETTINGS, 0, nothing)
    for path in shards.iterdir():
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes()


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_stranger_streams_them_through_webdataset(shards: Path) -> None:
    """It leaves files open that it has read to their end, hence the warnings."""
    urls = [str(path) for path in sorted(shards.glob("fold0-*.tar"))]
    stream = webdataset.WebDataset(urls, shardshuffle=False).decode().to_tuple("cloud.npy", "json")
    loader = torch.utils.data.DataLoader(stream.map_tuple(torch.from_numpy, lambda about: about["label"]), batch_size=4)
    (batch,) = loader
    assert batch[0].shape == (4, 40, 3) and batch[0].dtype == torch.float32
    assert sorted(batch[1].tolist()) == [0, 0, 1, 1]
    keys = [sample["__key__"] for sample in webdataset.WebDataset(urls, shardshuffle=False)]
    assert sorted(keys) == ["box_a_NPG_0", "box_a_NPG_1", "box_a_WPG_2", "box_a_WPG_3"]


class Shards(torch.utils.data.IterableDataset):
    """What somebody without any library writes."""

    def __init__(self, paths: list[Path]) -> None:
        self.paths = paths

    def __iter__(self):
        for path in self.paths:
            with tarfile.open(path) as shard:
                files = {member.name: shard.extractfile(member).read() for member in shard}
            for name in files:
                if name.endswith(".json"):
                    cloud = np.load(io.BytesIO(files[name.replace(".json", ".cloud.npy")]))
                    yield torch.from_numpy(cloud), json.loads(files[name])["label"]


def test_a_stranger_streams_them_through_torch(shards: Path) -> None:
    loader = torch.utils.data.DataLoader(Shards(sorted(shards.glob("*.tar"))), batch_size=8)
    (batch,) = loader
    assert batch[0].shape == (8, 40, 3) and int(batch[1].sum()) == 4


def test_a_shard_cut_anywhere_is_told(shards: Path, tmp_path: Path) -> None:
    whole, path = (shards / "fold0-000.tar").read_bytes(), tmp_path / "cut.tar"
    cuts = [0, 100, 512, len(whole) // 2, *range(1024, 6144, 512)]
    assert sum(1 for _ in read_samples(shards / "fold0-000.tar")) == 3
    for cut in cuts:
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError) as error:
            list(read_samples(path))
        assert "cut.tar" in refusal(error.value)
    with pytest.raises(InputError, match="no such file"):
        list(read_samples(tmp_path / "none.tar"))


ABOUT = {"type": "NPG", "label": 1, "outcome": "success", "object": "a", "class": "boxes", "fold": 0, "index": 0}


def npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


CLOUD = npy(np.zeros((5, 3), np.float32))


@pytest.mark.parametrize(
    ("cloud", "about", "words"),
    [
        (None, ABOUT, ["cloud.npy"]),
        (b"not an array", ABOUT, ["cloud.npy"]),
        (npy(np.zeros((5, 3))), ABOUT, ["(P, 3) float32", "float64"]),
        (npy(np.full((5, 3), np.nan, np.float32)), ABOUT, ["finite"]),
        (CLOUD.replace(b"(5, 3), ", b"(9000000000000, 3), "), ABOUT, ["cloud.npy"]),  # no room is made for it
        (CLOUD[:-4], ABOUT, ["5 points"]),
        (CLOUD, {**ABOUT, "label": 2}, ["label", "got 2"]),
        (CLOUD, {**ABOUT, "outcome": "held"}, ["outcome", "got 'held'"]),
        (CLOUD, {"type": "NPG"}, ["label"]),
        (CLOUD, [[]], ["keys and values"]),
    ],
)
def test_other_samples_are_told(cloud: bytes | None, about: Any, words: list[str], tmp_path: Path) -> None:
    files = {"a.json": json.dumps(about).encode()} | ({} if cloud is None else {"a.cloud.npy": cloud})
    with tar.written(tmp_path / "other.tar") as shard:
        for name, content in files.items():
            tar.add(shard, name, content)
    with pytest.raises(InputError) as error:
        list(read_samples(tmp_path / "other.tar"))
    assert all(word in refusal(error.value) for word in ["other.tar", *words]), error.value


def test_other_tars_are_told(tmp_path: Path) -> None:
    path = tmp_path / "other.tar"
    member = tarfile.TarInfo("a.json")
    for kind, size, words in ((tarfile.SYMTYPE, 0, "none"), (tarfile.REGTYPE, tar.LARGEST + 1, "64000001")):
        member.type, member.size = kind, size
        path.write_bytes((member.tobuf() + bytes(20 * 512))[: tarfile.RECORDSIZE])
        with pytest.raises(InputError, match=words):
            list(read_samples(path))
    with tar.written(path) as shard:
        tar.add(shard, "noending", b"")
    with pytest.raises(InputError, match=r"KEY.ENDING, each once, got 'noending'"):
        list(read_samples(path))
