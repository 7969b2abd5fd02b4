"""Sensitivity indices: how much each factor makes an output vary, with intervals; one method per module."""

from tripod_doe.analyses.sensitivity import delta, dgsm, fast, morris, pawn, rbd_fast, shapley, sobol

RANKED = {
    "sobol": sobol.METHOD.ranked,
    "morris": morris.METHOD.ranked,
    "dgsm": dgsm.METHOD.ranked,
    "fast": fast.METHOD.ranked,
    "rbd-fast": rbd_fast.METHOD.ranked,
    "pawn": pawn.METHOD.ranked,
    "delta": delta.METHOD.ranked,
    "shapley": shapley.METHOD.ranked,
    "multifidelity": sobol.METHOD.ranked,
}
"""The index by which each kind of analysis ranks the factors, if it has indices."""
