"""Slabs as tasks of Dask's scheduler: the same bits, also where workers die."""

import os
import signal
from pathlib import Path

import pytest
import toys
from slabbed import assert_bit_equal, lines_of, room

import sdhj
from sdhj.outofcore import planned, runner
from sdhj.solver.slabs import Task
from sdhj.solving import method_of
from sdhj.table.store import Store, opened_store

dask = pytest.importorskip("dask")
cloudpickle = pytest.importorskip("cloudpickle")
distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),  # so that few workers have to be started anew
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            dashboard_address=None,
            local_directory=str(tmp_path_factory.mktemp("dask")),
            worker_class=distributed.Nanny,
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def threads():
    """Two workers in this process, which takes seconds less."""
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def test_workers_give_every_bit(threads, tmp_path):
    problem = toys.torus_problem(nodes=40, steps=2)
    stored = sdhj.solve(problem, store=tmp_path / "t", client=threads, memory=room(problem, width=8))
    assert stored.details["slabs"] > 4
    assert_bit_equal(stored, sdhj.solve(problem))


@pytest.mark.slow
def test_workers_give_every_bit_though_one_is_killed(client, tmp_path, monkeypatch):
    """While they have a tube's tasks in hand, and some tubes are there."""
    problem, store = toys.torus_problem(nodes=40), tmp_path / "t"
    victim, killed, submit = next(iter(client.run(os.getpid).values())), [], client.submit

    def killing(*task, **options):
        if not killed and len(lines_of(store, "tubes")) >= 5:
            killed.append(os.kill(victim, signal.SIGKILL))
        return submit(*task, **options)

    monkeypatch.setattr(client, "submit", killing)
    stored = sdhj.solve(problem, store=store, client=client, memory=room(problem, width=4))
    assert killed
    assert victim not in client.run(os.getpid).values()
    assert stored.details["slabs"] > 8
    assert_bit_equal(stored, sdhj.solve(problem))


def test_an_error_in_a_worker_is_told(threads, tmp_path):
    problem = toys.torus_problem(nodes=40)
    sdhj.solve(problem, store=tmp_path / "t", memory=room(problem, width=10))
    (tmp_path / "t" / "avoid_moving.npy").unlink()
    plan, (store, *_) = planned(problem, method_of("hji"), (0, 10)), opened_store(tmp_path / "t", problem)
    with pytest.raises(sdhj.TableFileError, match="is missing"):
        list(runner(plan, store, threads)([Task("extend", 2, 2, 1, 0)]))


class Deadly:
    """A plan that ends its worker, as one does for which there is not memory enough."""

    @property
    def avoid(self):
        os._exit(1)


@pytest.mark.slow
def test_a_slab_that_ends_every_worker_is_told(client):
    with pytest.raises(distributed.KilledWorker) as told:
        list(runner(Deadly(), Store(Path("a"), None, ""), client)([Task("goal", 0, 0)]))
    assert "what is finished stays in a: solve with resume=True" in told.value.__notes__[0]


def test_no_array_goes_through_the_scheduler(tmp_path):
    """A task is a few kilobytes, whatever the size of the grid."""
    sizes = []
    for nodes in (40, 200):
        problem = toys.torus_problem(nodes=nodes)
        sizes.append(len(cloudpickle.dumps((planned(problem, method_of("hji"), (0, 10)), Task("goal", 0, 0)))))
    assert max(sizes) < 50_000
    assert abs(sizes[1] - sizes[0]) < 100
