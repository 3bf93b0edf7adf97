"""Two solves at once, and processes forked off one that has solved: on every threading layer of Numba that there is."""

import importlib
import os
import subprocess
import sys

import pytest
import zoo

LAYERS = {"tbb": "tbbpool", "omp": "omppool", "workqueue": "workqueue"}
PROBLEM = """
import sys, threading, multiprocessing
sys.path.insert(0, TESTS)
import numba, numpy as np, sdhj
from sdhj.kernels import compiling
from zoo import torus_problem

compiling.free_cores = lambda: 2  # however busy the machine is

def solved(number=0):
    table = sdhj.solve(torus_problem(nodes=12 + number % 3, steps=2), progress=False)
    return float(table.values(start=0, within=2).sum())
"""


def there(layer):
    try:
        importlib.import_module(f"numba.np.ufunc.{LAYERS[layer]}")
    except ImportError:
        return False
    return True


@pytest.fixture(params=LAYERS)
def run(request):
    """Runs code in a process on one layer, two threads; what it prints, and its standard error."""
    if not there(request.param):
        pytest.skip(f"the layer {request.param} is not installed")

    def run(code):
        code = PROBLEM.replace("TESTS", repr(os.path.dirname(zoo.__file__))) + code
        environment = {**os.environ, "NUMBA_THREADING_LAYER": request.param, "NUMBA_NUM_THREADS": "2"}
        done = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=300
        )
        return request.param, done

    return run


@pytest.mark.slow
def test_solves_at_once_are_as_one_after_the_other(run):
    code = """
expected, found = [solved(number) for number in range(3)], {}

def repeatedly(number):
    found[number] = {solved(number) for _ in range(5)}

threads = [threading.Thread(target=repeatedly, args=(number,)) for number in range(3)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
print(numba.threading_layer(), all(found[number] == {expected[number]} for number in range(3)))
"""
    layer, done = run(code)
    assert done.stdout.split() == [layer, "True"], done.stderr


@pytest.mark.slow
def test_a_process_forked_off_after_a_solve_works_or_says_what_to_do(run):
    """In a pool, which would wait for ever for a process that was ended."""
    code = """
expected = [solved(number) for number in range(3)]
with multiprocessing.get_context("fork").Pool(2) as pool:
    try:
        print(pool.map(solved, range(3)) == expected)
    except RuntimeError as error:
        print(error)
print(solved() == expected[0])
"""
    layer, done = run(code)
    told, after = done.stdout.splitlines()
    assert after == "True"
    if layer == "omp" and importlib.import_module("numba.np.ufunc.omppool").openmp_vendor == "GNU":
        assert "start processes with multiprocessing.get_context('spawn')" in told
    else:
        assert told == "True", done.stderr


@pytest.mark.slow
def test_a_process_forked_off_before_any_solve_works(run):
    code = """
with multiprocessing.get_context("fork").Pool(1) as pool:
    print(pool.map(solved, [0]) == [solved()])
"""
    assert run(code)[1].stdout.split() == ["True"]
