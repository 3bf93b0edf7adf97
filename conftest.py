"""Doctests are collected where what a module needs is installed; a test that cannot be imported is an error."""

from importlib.util import find_spec

collect_ignore = [] if find_spec("gymnasium") else ["sdhj/simulation/environment.py"]
