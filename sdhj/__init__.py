"""Sampled-data Hamilton-Jacobi reachability for robust motion planning (Kleff & Li, Robotica 2020).

Conventions: a set is where its level-set function is <= 0, so values are negative inside; a union is the minimum of the
functions, an intersection the maximum, a complement the negative. The robot's input minimises, the adversary maximises.
Units are metres, radians and seconds. A robot's functions are plain NumPy and are read once, as formulas
(`sdhj.formulas`); one that cannot be read is wrapped in a `BlackBox`. An argument that does not fit is a ValueError
that names it and says what was expected.

A robot on a line, pushed by a disturbance of up to 0.2 m/s, must come within 1 m of the origin and never beyond 3 m:

>>> import numpy as np
>>> import sdhj
>>> speeds = [[-1.0], [0.0], [1.0]]
>>> problem = sdhj.ReachAvoidProblem(
...     grid=sdhj.Grid([-4.0], [4.0], [81]),
...     dynamics=sdhj.Dynamics(inputs=speeds, drift=speeds, gain=[[1.0]], bounds=[0.2]),
...     target=sdhj.TargetSet((0,), lambda points, t: abs(points[:, 0]) - 1.0),
...     unsafe=[sdhj.UnsafeSet((0,), lambda points, t: 3.0 - points[:, 0])],
...     delta=0.5,
...     steps=5,
... )
>>> table = sdhj.solve(problem)
>>> table.contains([[-2.1], [2.95]], start=0, within=3)
array([ True, False])
>>> controller = sdhj.Controller(table)
>>> controller.steps_to_go([-2.1], 0), problem.inputs[controller.select([-2.1], 0)]
(3, array([1.]))
"""

import os
import warnings

# Idle threads sleep: spinning, OpenMP's default, slows a solve tenfold on cores that other processes use. They spin for
# some 50 microseconds first, the gap between two kernels, or the system may wake both of them on one core.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("GOMP_SPINCOUNT", "10000")
# Numba cannot be imported with an invalid number of threads.
if not (_threads := os.environ.get("NUMBA_NUM_THREADS", "1")).isdecimal() or not 1 <= int(_threads) <= 4096:
    warnings.warn(
        f"NUMBA_NUM_THREADS must be a whole number from 1 to 4096, got {_threads}; all cores are used", stacklevel=2
    )
    del os.environ["NUMBA_NUM_THREADS"]

from sdhj.arm.case_studies import arm_case_study, evader_case_study
from sdhj.certified.export import export_c
from sdhj.certified.sets import Certified
from sdhj.common.findings import ProjectionWarning, ResolutionWarning, UnsettledWarning
from sdhj.formulas.arrays import NotTraced
from sdhj.formulas.formula import BlackBox, complement, intersection, union
from sdhj.formulas.gridded import gridded
from sdhj.problem.ball import Ball
from sdhj.problem.dynamics import Dynamics
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sensing import Sensing
from sdhj.problem.sets import TargetSet, UnsafeSet
from sdhj.problem.shapes.bodies import Body
from sdhj.simulation.adversaries import Moment
from sdhj.simulation.records import bounds_from_records
from sdhj.simulation.runs import monte_carlo, simulate
from sdhj.solver.methods import HJI, HopfLax
from sdhj.solver.projections import Projected
from sdhj.solver.schemes import Scheme
from sdhj.solving import load, solve
from sdhj.table.controller import Controller, NotAdmissible
from sdhj.table.cost_to_go import CostToGo
from sdhj.table.files import VERSION as __version__
from sdhj.table.files import TableFileError
from sdhj.table.rules import Candidates
from sdhj.table.table import LookupTable

__all__ = [
    "HJI",
    "Ball",
    "BlackBox",
    "Body",
    "Candidates",
    "Certified",
    "Controller",
    "CostToGo",
    "Dynamics",
    "Grid",
    "HopfLax",
    "LookupTable",
    "Moment",
    "NotAdmissible",
    "NotTraced",
    "Projected",
    "ProjectionWarning",
    "ReachAvoidProblem",
    "ResolutionWarning",
    "Scheme",
    "Sensing",
    "TableFileError",
    "TargetSet",
    "UnsafeSet",
    "UnsettledWarning",
    "__version__",
    "arm_case_study",
    "bounds_from_records",
    "complement",
    "evader_case_study",
    "export_c",
    "gridded",
    "intersection",
    "load",
    "monte_carlo",
    "simulate",
    "solve",
    "union",
]
