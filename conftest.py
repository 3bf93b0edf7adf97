"""Doctests are collected where what a module needs is installed; a test that cannot be imported is an error."""

import os
import sys
from importlib.util import find_spec

collect_ignore = [] if find_spec("gymnasium") else ["sdhj/simulation/environment.py"]

# Rewriting the tests for pytest's assertions takes half of what collecting them does. Both workers, each later run and
# the programs that tests start read what was rewritten, from the folders in which Numba keeps its code.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
