"""Estimation of the unknowns of a fit: from misfits to minima, intervals and verdicts."""
