"""Objects described on a Dask cluster: the same bits as here, made on the workers and nowhere else."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from small_world import everything, experiment, world
from test_describe import GRASPS, OBJECTS, describer, forbidden, same

from spgf_torch.cache import Cache
from spgf_torch.errors import IncompleteError, InputError
from spgf_torch.experiment import describe as module
from spgf_torch.experiment.cluster import Cluster, cluster_of, made_steps
from spgf_torch.experiment.describe import Describer
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.progress import ProgressReporter

pytest.importorskip("distributed")


class Future:
    def __init__(self, work: Any, *arguments: Any) -> None:
        self.work, self.arguments = work, arguments

    def result(self) -> Any:
        return self.work(*self.arguments)


class Client:
    """Does when asked for it what a cluster is sent, after a journey as bytes; lists what was wanted."""

    def __init__(self) -> None:
        self.sent: list[list[str]] = []

    def nthreads(self) -> dict[str, int]:
        return {"here": 1}

    def scatter(self, content: Any, broadcast: bool, hash: bool) -> Any:
        assert broadcast and not hash
        return pickle.loads(pickle.dumps(content))

    def submit(self, work: Any, *arguments: Any, pure: bool) -> Future:
        assert not pure
        self.sent.append(arguments[-1])
        return Future(*pickle.loads(pickle.dumps((work, *arguments))))


def described(by: Describer) -> list[DescribedObject]:
    return by.describe(OBJECTS, GRASPS, ProgressReporter())


def test_workers_make_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the caller's cache lacks is made by them and kept there; then nothing is sent any more."""
    here, client = described(describer()), Client()
    cluster = Cluster(client, "nowhere")
    assert same(described(describer(cluster=cluster)), here) and len(client.sent) == 2
    cold = describer(Cache(tmp_path), cluster=cluster)
    assert same(described(cold), here) and client.sent[2:] == [["texlets", "features", "collisions"]] * 2
    for entry in tmp_path.glob("features-*"):
        entry.unlink()
    assert same(described(replace(cold, cache=Cache(tmp_path))), here) and client.sent[4:] == [["features"]] * 2
    for step in ("sense", "sensed_collision"):
        monkeypatch.setattr(module, step, forbidden(getattr(module, step)))
    assert same(described(replace(cold, cache=Cache(tmp_path))), here) and len(client.sent) == 6


def test_two_workers_of_dask(tmp_path: Path) -> None:
    """In threads of this process: others take seconds to start. Any free port: None would still be 8787."""
    from distributed import LocalCluster

    settings: dict[str, Any] = {"dashboard_address": ":0", "local_directory": str(tmp_path)}
    local = LocalCluster(n_workers=2, threads_per_worker=1, processes=False, **settings)
    made = experiment(world(cells=4), inner_grasps=25, final_model=True)
    with local, cluster_of(local.scheduler_address) as cluster:
        there, learned = described(describer(cluster=cluster)), made.run(ProgressReporter(), cluster)
    assert same(there, described(describer()))
    assert everything(learned) == everything(made.run(ProgressReporter()))


@pytest.mark.parametrize("final_model", [True, False])
def test_workers_learn_the_same_bits(final_model: bool) -> None:
    """Scores of all objects, models of folds and of all; an experiment goes to the workers once, sets one by one."""
    examples, client, stages = world(cells=4), Client(), ProgressReporter()
    made = experiment(examples, inner_grasps=25, final_model=final_model)
    here, there = made.run(stages), made.run(stages, Cluster(client, "nowhere"))
    assert everything(there) == everything(here) and len(here.scores) == 6 and len(here.of_fold) == 3
    assert len(client.sent) == 2 * (3 + 3 + final_model)


def test_a_cluster_that_goes_away_ends_the_work_in_one_line() -> None:
    class Gone(Client):
        def submit(self, work: Any, *arguments: Any, pure: bool) -> Future:
            def lost() -> None:
                raise TimeoutError("no answer")

            return Future(lost)

    with pytest.raises(IncompleteError, match=r"^address: the Dask cluster at tcp://x:1 went away \(no answer\)"):
        described(describer(cluster=Cluster(Gone(), "tcp://x:1")))


def test_no_address_is_no_cluster(monkeypatch: pytest.MonkeyPatch) -> None:
    with cluster_of(None) as cluster:
        assert cluster is None
    monkeypatch.setattr("spgf_torch.simulation.executors.PATIENCE", 0.2)
    with pytest.raises(InputError, match="address: expected a Dask scheduler"), cluster_of("tcp://127.0.0.1:9"):
        pass


def test_only_what_is_wanted_is_made() -> None:
    rooms = {name: value for name, value in vars(describer()).items() if name not in ("cache", "cluster")}
    made = made_steps(rooms, OBJECTS[0], GRASPS[0], ["features"])
    assert [*made] == ["features"] and isinstance(made["features"], bytes)
