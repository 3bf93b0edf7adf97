"""What a plan states that a slab takes is not exceeded by the process that solves it."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
CHILD = """
import sys
import sdhj, large
from sdhj.solving import method_of
from sdhj.outofcore import planned, task_bytes

name, nodes, method, memory = sys.argv[1], int(sys.argv[2]), sys.argv[3], int(sys.argv[4])
make = sdhj.arm_case_study if name == "case study" else large.WORKED[name].problem
sdhj.solve(make(9), method, store="small", progress=False)  # what is compiled and imported is there from now on
problem = make(nodes)
plan = planned(problem, method_of(method), room=memory)
print(plan.layout.slabs, task_bytes(plan), plan.layout.nbytes, flush=True)
sys.stdin.readline()
sdhj.solve(problem, method, store="large", memory=memory, progress=False)
"""


def anonymous(process: subprocess.Popen) -> int:
    """Bytes of memory that a process has, without pages of files, which the system takes back where it needs them."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return next((1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith("RssAnon")), 0)


def memory_of(name: str, nodes: int, method: str, memory: int, folder: Path) -> tuple[int, int, int, int]:
    """Slabs, bytes stated for one, bytes of the arrays, and the most that a process took, looked at every 2 ms.

    One arena of the C library, as what several keep of freed memory depends on threads and chance.
    """
    studies = Path(__file__).parents[2] / "figures" / "studies"
    paths = os.pathsep.join([str(studies), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"MALLOC_ARENA_MAX": "1", "PYTHONPATH": paths}
    command = [sys.executable, "-W", "ignore", "-c", CHILD, name, str(nodes), method, str(memory)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=folder, env=environment, **pipes) as child:
        slabs, stated, arrays = map(int, child.stdout.readline().split())
        before, most = anonymous(child), 0
        print(file=child.stdin, flush=True)
        while child.poll() is None:
            most = max(most, anonymous(child))
            time.sleep(0.002)
    assert child.returncode == 0
    return slabs, stated, arrays, most - before


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="what is taken is asked of Linux")
@pytest.mark.parametrize(
    ("name", "nodes", "memory", "slabs"),
    [("case study", 25, 10**10, 1), ("case study", 32, 18 * 10**7, 3), ("car", 13, 10**10, 1)],
)
def test_a_process_takes_no_more_than_is_stated(name, nodes, memory, slabs, tmp_path):
    cut, stated, _, taken = memory_of(name, nodes, "hji", memory, tmp_path)
    assert cut == slabs
    assert taken <= stated <= memory
    assert taken > stated / 4  # nor does it state so much that slabs are thinner than they must be
