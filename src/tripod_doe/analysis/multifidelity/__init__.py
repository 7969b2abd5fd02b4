"""Several models at once: what the dearest model would answer, from a few of its samples and many of cheaper ones."""

from tripod_doe.analysis.multifidelity.answers import MultifidelitySettings, multifidelity

__all__ = ["MultifidelitySettings", "multifidelity"]
