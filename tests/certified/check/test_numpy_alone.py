"""The checker rests on NumPy and Python's standard library: in a fresh process nothing else is loaded."""

import subprocess
import sys
from pathlib import Path

from forged_robots import solved

import sdhj

ALONE = """
import sys, types

for name in ("sdhj", "sdhj.certified"):  # the folders, without what their own files import
    sys.modules[name] = types.ModuleType(name)
    sys.modules[name].__path__ = [f"{sys.argv[1]}/{name.replace('.', '/')}"]
from sdhj.certified.check import verify

print(verify(sys.argv[2], progress=True).ok)
found = {name.partition(".")[0] for name in sys.modules} - sys.stdlib_module_names
print(*sorted(name for name in found if not name.startswith("_") and name not in OWN))
print(*sorted(name for name in sys.modules if name.startswith("sdhj.certified.check.arm")))
"""


def test_a_file_is_verified_without_numba_or_scipy(tmp_path):
    solved("line").save(path := tmp_path / "line.npz")
    own = subprocess.run([sys.executable, "-c", "import sys; print(*sys.modules)"], capture_output=True, text=True)
    code = ALONE.replace("OWN", repr({name.partition(".")[0] for name in own.stdout.split()}))
    done = subprocess.run(
        [sys.executable, "-c", code, Path(sdhj.__file__).parents[1], path], capture_output=True, text=True
    )
    proved, loaded, *rest = done.stdout.splitlines()
    assert proved == "True" and rest == [""], done.stdout + done.stderr
    assert set(loaded.split()) - {"cython_runtime"} == {"numpy", "sdhj"}  # that runtime is some versions of NumPy's own
    assert "moves: " in done.stderr and "sets: " in done.stderr
