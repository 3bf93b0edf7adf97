"""Sets with a proof, and their independent checker, `sdhj.certified.check`, which imports nothing of the rest."""

from sdhj.certified.sets import Certified
from sdhj.certified.table import CertifiedTable

__all__ = ["Certified", "CertifiedTable"]
