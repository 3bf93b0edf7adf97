"""Entries as tasks of Dask's scheduler: the same bits, also where workers die."""

import os
import signal

import numpy as np
import pytest
import zoo
from on_disk import assert_bit_equal

import sdhj
from sdhj.problem.samples import Samples
from sdhj.solver.entries import Folder, Part

dask = pytest.importorskip("dask")
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


def turning(inputs=25):
    """A car with many inputs, of which each has a game of its own; nothing depends on time."""
    return zoo.unicycle_problem(np.linspace(-1.0, 1.0, inputs), nodes=(9, 9, 12), steps=4)


def ring():
    """At three speeds, of which each has a game of its own, as intervals may end early."""
    return zoo.ring(sensing=sdhj.Sensing(jitter=0.05))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "method"),
    [
        (lambda: zoo.torus_problem(nodes=24), "hji"),
        (lambda: zoo.torus_problem(nodes=24), "lax"),
        (turning, "hji"),
        (lambda: zoo.interval_problem(steps=4, ends="unsafe"), sdhj.HJI(sdhj.Scheme(frame="fixed"))),
        (lambda: sdhj.arm_case_study(nodes=7, steps=3), "projected"),
    ],
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_workers_give_every_bit(threads, tmp_path, make, method):
    problem = make()
    stored = sdhj.solve(problem, method, store=tmp_path / "t", client=threads, progress=False)
    table = sdhj.solve(problem, method, progress=False, play=False)
    assert_bit_equal(stored, table)
    assert stored.details["pdes_solved"] == table.details["pdes_solved"]


@pytest.mark.slow
@pytest.mark.parametrize("inputs", [25, 9, 1])
def test_inputs_of_one_row_are_shared_out_evenly(threads, tmp_path, monkeypatch, inputs):
    found, share, write = [], Folder._share, Folder._compute

    def told(self, part):
        found.append((distributed.get_worker().address, part.within))
        share(self, part)

    def counted(self, part, tube, marks, *some):
        if some:
            found[-1] += (part.share, *some[0])
        write(self, part, tube, marks, *some)

    monkeypatch.setattr(Folder, "_share", told)
    monkeypatch.setattr(Folder, "_compute", counted)
    problem = turning(inputs)
    stored = sdhj.solve(problem, store=tmp_path / "t", client=threads, progress=False)
    for within in range(2, 5) if inputs > 1 else []:  # those of the first step wait for nothing
        its = [one for one in found if one[1] == within]
        assert {one[0] for one in its} == {*threads.scheduler_info()["workers"]}
        assert sorted(j for one in its for j in one[3:]) == [*range(inputs)]
        assert abs(len(its[0]) - len(its[1])) <= 1
    assert (inputs > 1) == bool(found)
    assert not (tmp_path / "t" / "shares").exists()
    assert_bit_equal(stored, sdhj.solve(problem, progress=False, play=False))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("make", [turning, ring])
def test_avoid_tubes_are_shared_out_evenly(threads, tmp_path, monkeypatch, make):
    """By differences, and by the formula of the moving frame."""
    found, avoid, problem = [], Folder._avoid, make()
    assert sdhj.HJI().on(Samples(problem)).uses_hopf_lax((0,)) == (make is ring)

    def told(self, part):
        found.append((distributed.get_worker().address, self.inputs_of(part)))
        return avoid(self, part)

    monkeypatch.setattr(Folder, "_avoid", told)
    stored = sdhj.solve(problem, store=tmp_path / "t", client=threads, progress=False)
    assert len(found) == len({at for at, _ in found}) == 2
    assert sorted(j for _, some in found for j in some) == [*range(len(problem.inputs))]
    assert abs(len(found[0][1]) - len(found[1][1])) <= 1
    assert_bit_equal(stored, sdhj.solve(problem, progress=False, play=False))


@pytest.mark.slow
@pytest.mark.parametrize("by", [None, 1, 2])
def test_a_solve_goes_on_with_a_share_of_the_avoid_tubes(threads, tmp_path, monkeypatch, by):
    """By itself, and by a client that has one worker or both of them: only both have what is there."""
    problem, avoid, done, store = turning(), Folder._avoid, [], tmp_path / "t"

    def fails(self, part):
        raise RuntimeError("ended")

    def counted(self, part):
        done.append(part)
        return avoid(self, part)

    with monkeypatch.context() as patch, pytest.raises(RuntimeError, match="ended"):
        patch.setattr(Folder, "_share", fails)
        sdhj.solve(problem, store=store, client=threads, progress=False)
    # as though it had been ended within the other share
    (store / "done" / "avoid_static-0-0-1-of-2").unlink()
    tubes = np.load(store / "avoid_static.npy", mmap_mode="r+")
    tubes[Folder(store, problem, sdhj.HJI()).inputs_of(Part("avoid_static", 0, 0, 1, 2))] = np.nan
    tubes.flush()
    monkeypatch.setattr(Folder, "_avoid", counted)
    workers = dict([*threads.nthreads().items()][:by])
    monkeypatch.setattr(threads, "nthreads", lambda: workers)
    client = None if by is None else threads
    stored = sdhj.solve(problem, store=store, client=client, resume=True, progress=False)
    assert [(part.share, part.shares) for part in done] == [(1, 2) if by == 2 else (0, 0)]
    assert_bit_equal(stored, sdhj.solve(problem, progress=False, play=False))


@pytest.mark.slow
def test_avoid_tubes_that_are_whole_are_not_shared_out(threads, tmp_path, monkeypatch):
    problem, complete, avoid, found = turning(), Folder.complete, Folder._avoid, []

    def limited(self, part):
        if part == Part("entry", 0, 1):
            raise KeyboardInterrupt
        complete(self, part)

    def told(self, part):
        found.append(part)
        return avoid(self, part)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Folder, "complete", limited)
        sdhj.solve(problem, store=tmp_path / "t", progress=False)
    monkeypatch.setattr(Folder, "_avoid", told)
    stored = sdhj.solve(problem, store=tmp_path / "t", client=threads, resume=True, progress=False)
    assert not found
    assert_bit_equal(stored, sdhj.solve(problem, progress=False, play=False))


@pytest.mark.slow
def test_rows_of_entries_are_shared_out(threads, tmp_path, monkeypatch):
    found, entry = [], Folder._entry

    def told(self, part):
        if part.within > 1:
            found.append((part.step, distributed.get_worker().address))
        return entry(self, part)

    monkeypatch.setattr(Folder, "_entry", told)
    sdhj.solve(zoo.torus_problem(nodes=12), store=tmp_path / "t", client=threads, progress=False)
    at = dict(found)
    assert len({*found}) == len(at) > 1  # a row is one worker's, and the next one another's
    assert all(at[step] != at[step + 1] for step in at if step + 1 in at)


@pytest.mark.slow
def test_shares_that_were_torn_are_not_believed(threads, tmp_path, monkeypatch):
    """A share is not flushed, so that a machine that fails may leave any bytes of it."""
    problem, store, share = turning(), tmp_path / "t", Folder._share

    def torn(self, part):
        share(self, part)
        if part.within == 3:
            os.truncate(store / "shares" / part.name, 1000)

    with monkeypatch.context() as patch, pytest.raises(Exception, match=r".+") as told:
        patch.setattr(Folder, "_share", torn)
        sdhj.solve(problem, store=store, client=threads, progress=False)
    assert "solve with resume=True" in told.value.__notes__[0]
    assert any((store / "shares").iterdir())
    stored = sdhj.solve(problem, store=store, client=threads, resume=True, progress=False)
    assert_bit_equal(stored, sdhj.solve(problem, progress=False, play=False))


@pytest.mark.slow
@pytest.mark.parametrize("make", [lambda: zoo.torus_problem(nodes=40), turning])
def test_workers_give_every_bit_though_one_is_killed(client, tmp_path, monkeypatch, make):
    """While they have entries in hand, and some are there."""
    problem, store = make(), tmp_path / "t"
    victim, killed, submit = next(iter(client.run(os.getpid).values())), [], client.submit

    def killing(*task, **options):
        if not killed and (store / "done").exists() and any((store / "done").glob("entry-*")):
            killed.append(os.kill(victim, signal.SIGKILL))
        return submit(*task, **options)

    monkeypatch.setattr(client, "submit", killing)
    stored = sdhj.solve(problem, store=store, client=client, progress=False)
    assert killed
    assert victim not in client.run(os.getpid).values()
    assert_bit_equal(stored, sdhj.solve(problem, progress=False))


@pytest.mark.slow
def test_an_error_in_a_worker_is_told(threads, tmp_path, monkeypatch):
    def fails(self, part):
        raise RuntimeError("no")

    monkeypatch.setattr(Folder, "_entry", fails)
    with pytest.raises(RuntimeError, match="no") as told:
        sdhj.solve(zoo.torus_problem(nodes=12), store=tmp_path / "t", client=threads, progress=False)
    assert "what is complete stays" in told.value.__notes__[0]


@pytest.mark.slow
def test_workers_with_too_little_memory_are_told(threads, tmp_path, monkeypatch):
    about = threads.scheduler_info()["workers"]
    few = next(iter(about.values())) | {"memory_limit": 10**7}
    many = {f"tcp://{number}": few | {"memory_limit": 2**40} for number in range(5)} | {"tcp://5": few}

    def told(n_workers=5, **_):
        """As of versions that tell of five by default."""
        return {"workers": dict([*many.items()][: None if n_workers == -1 else n_workers])}

    monkeypatch.setattr(threads, "scheduler_info", told)
    with pytest.raises(MemoryError, match=r"worker tcp://5 has 0\.01"):
        sdhj.solve(zoo.torus_problem(nodes=12), store=tmp_path / "t", client=threads, progress=False)
