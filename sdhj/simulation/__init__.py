"""Controllers played against adversaries, with the true dynamics and geometry; nothing that solves imports it."""

from sdhj.simulation.adversaries import ADVERSARIES, Adversary, Moment
from sdhj.simulation.runs import OUTCOMES, SUBSTEPS, Margins, Report, Trajectory, monte_carlo, simulate

__all__ = [
    "ADVERSARIES",
    "OUTCOMES",
    "SUBSTEPS",
    "Adversary",
    "Margins",
    "Moment",
    "Report",
    "Trajectory",
    "monte_carlo",
    "simulate",
]
