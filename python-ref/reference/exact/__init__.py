"""The same formulas at 50 digits: what f64 numpy itself rounds, and by how much.

Written apart from the f64 reference, as plain sums over pairs, and where there is a choice
by another route: poses by one eigenvector whatever the solver, the order of neighbours by
exact distances. Inputs are taken as the binary numbers they are, or as decimal text.
"""

from .moments import Sums, moments, residual, residual_of_pairs, weights
from .numbers import DIGITS, as_float, exact, mp, rows
from .pose import Solution, solve
from .surface import ExactFeatures, fpfh, plane

__all__ = [
    "DIGITS",
    "ExactFeatures",
    "Solution",
    "Sums",
    "as_float",
    "exact",
    "fpfh",
    "moments",
    "mp",
    "plane",
    "residual",
    "residual_of_pairs",
    "rows",
    "solve",
    "weights",
]
