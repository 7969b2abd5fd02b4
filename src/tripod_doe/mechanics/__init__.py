"""Mechanics of rigid-body scenes, compiled: what a scene is, its tables and one run. numpy, scipy and numba only."""
