"""The fit: the same arguments give the same prototypes, interrupted or not; other seeds nearly the same."""

from pathlib import Path

import pytest
import torch
from sklearn.cluster import KMeans
from sklearn.metrics import adjusted_rand_score
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import spgf
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import root
from spgf_torch.prototypes import lightning_module as module
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.prototypes.kmeans import assign, inertia
from spgf_torch.prototypes.lightning_module import CHECKPOINT, MiniBatches, MiniBatchKMeans, fit_prototypes
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import sense
from spgf_torch.settings import settings


@pytest.fixture(scope="module")
def relations() -> Tensor:
    """Features of five shipped objects."""
    found = []
    for obj in load_objects(root() / "data" / "objects")[::10]:
        texlets = sense(obj, settings(SensingConfig), 0)
        features = spgf(texlets.positions, texlets.normals, settings(FeatureConfig))
        found.append(features.relations()[features.valid])
    return torch.cat(found)


@pytest.fixture
def small() -> PrototypeConfig:
    return settings(PrototypeConfig, num_clusters=5, restarts=3, subsample=500, batch_size=256, epochs=4)


def test_stable_between_seeds_and_no_worse_than_scikit_learn(relations: Tensor) -> None:
    """On forty objects (benchmarks/kmeans.py): adjusted Rand index 0.99, inertia 0.6 % below scikit-learn's."""
    config = settings(PrototypeConfig, num_clusters=20)
    first, second = (fit_prototypes(relations, config, seed) for seed in (0, 1))
    assert first.shape == (20, 144) and first.dtype == torch.float32
    assert adjusted_rand_score(assign(relations, first), assign(relations, second)) >= 0.9
    peer = KMeans(20, n_init=10, random_state=0).fit(relations.numpy())
    assert max(inertia(relations, centres) for centres in (first, second)) <= 1.002 * peer.inertia_


def test_commonest_first(relations: Tensor, small: PrototypeConfig) -> None:
    counts = torch.bincount(assign(relations, fit_prototypes(relations, small, 0)))
    assert counts.tolist() == sorted(counts.tolist(), reverse=True)


def test_same_arguments_same_prototypes_and_no_word(
    relations: Tensor, small: PrototypeConfig, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    capfd.readouterr()
    first = fit_prototypes(relations, small, 0)
    assert torch.equal(first, fit_prototypes(relations, small, 0, tmp_path, progress=True))
    assert capfd.readouterr() == ("", "")
    assert [path.name for path in tmp_path.iterdir()] == [CHECKPOINT]


def test_one_and_two_threads_fit_alike(relations: Tensor) -> None:
    threads, found = torch.get_num_threads(), []
    try:
        for count in (1, 2):
            torch.set_num_threads(count)
            found.append(fit_prototypes(relations, settings(PrototypeConfig, num_clusters=20), 0))
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(*found)


def test_resumed_equals_uninterrupted(
    relations: Tensor, small: PrototypeConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed after the second checkpoint; the second call neither searches again nor repeats an epoch."""
    uninterrupted = fit_prototypes(relations, small, 0)
    steps: list[int] = []
    end, step = MiniBatchKMeans.on_train_epoch_end, MiniBatchKMeans.training_step

    def killed(self: MiniBatchKMeans) -> None:
        end(self)
        if self.current_epoch == 1:
            raise RuntimeError("killed")

    def counted(self: MiniBatchKMeans, batch: Tensor, batch_idx: int) -> None:
        steps.append(batch_idx)
        step(self, batch, batch_idx)

    def searched(*_: object) -> None:
        raise AssertionError("searched again")

    with monkeypatch.context() as patch:
        patch.setattr(MiniBatchKMeans, "on_train_epoch_end", killed)
        with pytest.raises(RuntimeError, match="killed"):
            fit_prototypes(relations, small, 0, tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(MiniBatchKMeans, "training_step", counted)
        patch.setattr(module, "initial_centres", searched)
        assert torch.equal(fit_prototypes(relations, small, 0, tmp_path), uninterrupted)
        assert len(steps) == 2 * -(-len(relations) // small.batch_size)
        assert torch.equal(fit_prototypes(relations, small, 0, tmp_path), uninterrupted)  # finished: nothing to do
        assert len(steps) == 2 * -(-len(relations) // small.batch_size)


@pytest.mark.parametrize("content", [b"", b"not a checkpoint", None])
def test_another_checkpoint_is_overwritten(
    content: bytes | None, relations: Tensor, small: PrototypeConfig, tmp_path: Path
) -> None:
    """Empty, foreign, or made from other data."""
    if content is None:
        fit_prototypes(relations[::2], small, 0, tmp_path)
    else:
        (tmp_path / CHECKPOINT).write_bytes(content)
    before = (tmp_path / CHECKPOINT).read_bytes()
    assert torch.equal(fit_prototypes(relations, small, 0, tmp_path), fit_prototypes(relations, small, 0))
    assert (tmp_path / CHECKPOINT).read_bytes() != before


def test_batches_cover_everything_once_in_an_order_of_their_epoch() -> None:
    values = torch.arange(10.0)[:, None]
    first, again, second = ([batch[:, 0].tolist() for batch in MiniBatches(values, 2, 0, epoch)] for epoch in (0, 0, 1))
    assert sorted(first) == [[0, 5], [1, 6], [2, 7], [3, 8], [4, 9]]
    assert first == again != second
    assert first != [batch[:, 0].tolist() for batch in MiniBatches(values, 2, 1, 0)]  # nor that of another seed
    assert sorted(len(batch) for batch in MiniBatches(values, 4, 0, 0)) == [3, 3, 4]


def test_few_features_that_differ() -> None:
    """Three distinct rows, a hundred copies: K = 3 finds them, K = 4 cannot."""
    rows = torch.tensor([[0.0, 1.0], [2.0, 0.0], [5.0, 5.0]])
    centres = fit_prototypes(rows.repeat(100, 1), settings(PrototypeConfig, num_clusters=3), 0)
    assert sorted(centres.tolist()) == sorted(rows.tolist())
    with pytest.raises(InputError, match="expected at least K = 4 features that differ, got 3"):
        fit_prototypes(rows.repeat(100, 1), settings(PrototypeConfig, num_clusters=4), 0)
    signed = torch.tensor([[0.0], [-0.0], [1.0]])
    with pytest.raises(InputError, match="got 2"):
        fit_prototypes(signed, settings(PrototypeConfig, num_clusters=3), 0)


def test_as_many_prototypes_as_features_and_one_for_all() -> None:
    rows = torch.randn(6, 144, generator=torch.Generator().manual_seed(0))
    centres = fit_prototypes(rows, settings(PrototypeConfig, num_clusters=6), 0)
    assert inertia(rows, centres) == pytest.approx(0.0, abs=1e-3)
    assert torch.allclose(fit_prototypes(rows, settings(PrototypeConfig, num_clusters=1), 0), rows.mean(0)[None])


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (torch.zeros(3, 2, 2), r"expected shape \(L, D\), got \(3, 2, 2\)"),
        (torch.tensor([[0.0], [float("nan")], [float("inf")]]), "others in 2 rows, first in 1"),
        (torch.zeros(0, 144), "at least K = 5 features that differ, got 0"),
    ],
)
def test_bad_relations_are_one_line(bad: Tensor, message: str, small: PrototypeConfig) -> None:
    with pytest.raises(InputError, match=message) as error:
        fit_prototypes(bad, small, 0)
    assert "\n" not in str(error.value)


def test_the_search_follows_the_seed() -> None:
    """One restart, no breath and one batch leave the seed nothing but the start: on noise others end elsewhere."""
    rows = torch.rand(400, 6, generator=torch.Generator().manual_seed(3))
    config = settings(PrototypeConfig, num_clusters=12, restarts=1, finalists=1, breath=0, batch_size=400, epochs=1)
    first, again, other = (fit_prototypes(rows, config, seed) for seed in (0, 0, 1))
    assert torch.equal(first, again) and not torch.allclose(first, other, atol=0.01)
