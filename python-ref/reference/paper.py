"""The two settings that the paper fixes (section IV-A), the defaults everywhere here."""

NEIGHBORS = 150
"""Nearest points for normals and FPFH, the point itself counted."""

BETA = 100.0
"""Bandwidth of the Gaussian, in the unit of squared FPFH distances at PCL's scale."""
