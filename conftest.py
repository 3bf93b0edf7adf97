"""Doctests are collected where what a module needs is installed; a test that cannot be imported is an error."""

import os
import sys
from importlib.util import find_spec

collect_ignore = [] if find_spec("gymnasium") else ["sdhj/simulation/environment.py"]

# Rewriting the tests for pytest's assertions takes half of what collecting them does, so it is kept, as Python keeps
# what it compiles: in __pycache__, also where PYTHONDONTWRITEBYTECODE is set. Later runs and tests' processes read it.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
