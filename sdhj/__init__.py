"""Sampled-data Hamilton-Jacobi reachability for robust motion planning (Kleff & Li, Robotica 2020).

Conventions, everywhere: a set is where its level-set function is <= 0 (inside is negative), union is min, intersection
is max, complement is the negative. The control minimises, the adversary maximises. Metres, radians, seconds.
"""

import os

# Idle threads sleep: spinning, OpenMP's default, slows a solve tenfold on cores that others use too. But they wait for
# some 50 microseconds first, the gap between two kernels, or the system may wake both of them on one core.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("GOMP_SPINCOUNT", "10000")

__version__ = "0.1.0"

from sdhj.case_studies import arm_case_study, evader_case_study
from sdhj.controller import Controller, NotAdmissible
from sdhj.grid import Grid
from sdhj.loading import load
from sdhj.problem import Dynamics, ReachAvoidProblem, TargetSet, UnsafeSet
from sdhj.recursion import solve
from sdhj.schemes import Scheme
from sdhj.search import search_losing
from sdhj.simulation import monte_carlo, simulate
from sdhj.table import LookupTable, TableFileError

__all__ = [
    "Controller",
    "Dynamics",
    "Grid",
    "LookupTable",
    "NotAdmissible",
    "ReachAvoidProblem",
    "Scheme",
    "TableFileError",
    "TargetSet",
    "UnsafeSet",
    "arm_case_study",
    "evader_case_study",
    "load",
    "monte_carlo",
    "search_losing",
    "simulate",
    "solve",
]
