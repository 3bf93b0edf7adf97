"""What a plan states that a slab takes is not exceeded by the process that solves it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
CHILD = """
import sys
import sdhj, large
from sdhj.solver.methods import method_of
from sdhj.outofcore import planned, task_bytes

def told(key):
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) * 1024 for line in status if line.startswith(key))

name, nodes, memory = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
make = sdhj.arm_case_study if name == "case study" else large.WORKED[name].problem
sdhj.solve(make(9), store="small", progress=False)  # what is compiled and imported is there from now on
problem = make(nodes)
plan = planned(problem, method_of("hji"), room=memory)
before = told("VmRSS")
with open("/proc/self/clear_refs", "w") as refs:
    refs.write("5")  # the peak is counted anew
sdhj.solve(problem, store="large", memory=memory, progress=False)
print(plan.slabs, task_bytes(plan), told("VmHWM") - before)
"""


@pytest.mark.skipif(not os.access("/proc/self/clear_refs", os.W_OK), reason="the peak is asked of Linux")
@pytest.mark.parametrize(
    ("name", "nodes", "memory", "slabs"),
    [("case study", 25, 10**10, 1), ("case study", 32, 25 * 10**7, 3), ("car", 13, 10**10, 1)],
)
def test_a_process_takes_no_more_than_is_stated(name, nodes, memory, slabs, tmp_path):
    """One arena of the C library, as what several keep of freed memory depends on threads and chance."""
    figures = Path(__file__).parents[2] / "figures"
    paths = os.pathsep.join([str(figures), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"MALLOC_ARENA_MAX": "1", "PYTHONPATH": paths}
    child = [sys.executable, "-W", "ignore", "-c", CHILD, name, str(nodes), str(memory)]
    done = subprocess.run(child, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    cut, stated, taken = map(int, done.stdout.split())
    assert cut == slabs
    assert taken <= stated <= memory
    assert taken > stated / 4  # nor does it state so much that slabs are thinner than they must be
