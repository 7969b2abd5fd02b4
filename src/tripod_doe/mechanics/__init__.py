"""Mechanics of rigid-body scenes: laws of contact and friction as compiled kernels. numpy, scipy and numba only."""

from tripod_doe.mechanics.compilation.numba_parts import check_numba

check_numba()
