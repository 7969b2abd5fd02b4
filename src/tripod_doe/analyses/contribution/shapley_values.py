"""Shapley values and interactions of mechanisms, from what each of their combinations makes of the whole.

References:
    Shapley 1953, A value for n-person games. Grabisch and Roubens 1999, An axiomatic approach to the concept of
    interaction among players in cooperative games.
"""

import math
from itertools import combinations

import numpy as np

from tripod_doe.array_types import FloatArray


def shapley_index(everything: list[FloatArray], count: int, members: tuple[int, ...]) -> FloatArray:
    """Shapley value of one mechanism or interaction index of two: the mean of their mixed difference over all S."""
    bits, width = [1 << member for member in members], len(members)
    chosen = [(sum(some), (-1) ** (width - size)) for size in range(width + 1) for some in combinations(bits, size)]
    total = np.zeros_like(everything[0])
    for others in range(len(everything)):
        if others & sum(bits):
            continue
        size = others.bit_count()
        weight = math.factorial(size) * math.factorial(count - size - width) / math.factorial(count - width + 1)
        total += weight * sum(sign * everything[others | some] for some, sign in chosen)
    return total


def shapley_bounds(everything: list[FloatArray], count: int, member: int) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest Shapley value of a mechanism, with every missing P between the smallest and largest known."""
    smallest, largest = np.fmin.reduce(everything), np.fmax.reduce(everything)

    def filled(with_it: FloatArray, without_it: FloatArray) -> FloatArray:
        """The Shapley value with these guesses for missing combinations with and without the mechanism."""
        guesses = [with_it if combination >> member & 1 else without_it for combination in range(len(everything))]
        known = [np.where(np.isnan(p), guess, p) for p, guess in zip(everything, guesses, strict=True)]
        return shapley_index(known, count, (member,))

    return filled(smallest, largest), filled(largest, smallest)
