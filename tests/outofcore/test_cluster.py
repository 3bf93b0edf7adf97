"""Slabs as tasks of Dask's scheduler: the same bits, also where workers die."""

import os
import signal
from dataclasses import replace

import pytest
import toys
from slabbed import assert_bit_equal, files_of, room

import sdhj
from sdhj.outofcore.cluster import shared_out
from sdhj.outofcore.slabs import Task
from sdhj.outofcore.solve import planned
from sdhj.solver.methods import method_of

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


def test_workers_give_every_bit_though_one_is_killed(client, tmp_path, monkeypatch):
    """While they have a tube's tasks in hand, and some tubes are there."""
    problem, store = toys.torus_problem(nodes=40), tmp_path / "t.zarr"
    victim, killed, as_completed = next(iter(client.run(os.getpid).values())), [], distributed.as_completed

    def killing(futures):
        if not killed and len(files_of(store, "tubes")) >= 5:
            killed.append(os.kill(victim, signal.SIGKILL))
        return as_completed(futures)

    monkeypatch.setattr(distributed, "as_completed", killing)
    stored = sdhj.solve(problem, store=store, client=client, memory=room(problem, width=4))
    assert killed
    assert victim not in client.run(os.getpid).values()
    assert stored.details["slabs"] > 8
    assert_bit_equal(stored, sdhj.solve(problem))


def test_an_error_in_a_worker_is_told(client, tmp_path):
    problem = toys.torus_problem(nodes=40)
    sdhj.solve(problem, store=tmp_path / "t.zarr", memory=room(problem, width=10))
    for file in files_of(tmp_path / "t.zarr", "avoid_moving"):
        file.unlink()
    plan = planned(problem, method_of("hji"), (0, 10))
    with pytest.raises(sdhj.TableFileError, match="is missing"):
        list(shared_out(client, replace(plan, path=tmp_path / "t.zarr"), [Task("extend", 0, 2, 2, 1, 0)]))


class Deadly:
    """A plan that ends its worker, as one does for which there is not memory enough."""

    path = "a.zarr"

    @property
    def store(self):
        os._exit(1)


@pytest.mark.slow
def test_a_slab_that_ends_every_worker_is_told(client):
    with pytest.raises(RuntimeError, match=r"one worker after the other.*resume=True"):
        list(shared_out(client, Deadly(), [Task("goal", 0)]))


def test_no_array_goes_through_the_scheduler(tmp_path):
    """A task is a few kilobytes, whatever the size of the grid."""
    sizes = []
    for nodes in (40, 400):
        problem = toys.torus_problem(nodes=nodes)
        sizes.append(len(cloudpickle.dumps((planned(problem, method_of("hji"), (0, 10)), Task("goal", 0)))))
    assert max(sizes) < 50_000
    assert abs(sizes[1] - sizes[0]) < 100
