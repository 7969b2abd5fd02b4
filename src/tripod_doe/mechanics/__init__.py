"""Mechanics of rigid-body scenes: laws of contact and friction as compiled kernels. numpy, scipy and numba only."""
