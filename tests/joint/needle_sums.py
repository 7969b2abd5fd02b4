"""Sums over the needles of a bearing one by one: the oracle of what is smeared over its circumference."""

import numpy as np


def loads(shift, clearance, stiffness, count, rotation):
    """Plain sum over real needles, the load zone's oracle; of several shifts, clearances or rotations each."""
    shift, clearance, rotation = (np.asarray(each)[..., None] for each in (shift, clearance, rotation))
    angle = rotation + 2 * np.pi * np.arange(count) / count
    pressed = np.maximum(shift * np.cos(angle) - clearance, 0)
    load = stiffness * (pressed / 2) ** (10 / 9)
    return (load * np.cos(angle)).sum(axis=-1), load.sum(axis=-1), load.max(axis=-1)
