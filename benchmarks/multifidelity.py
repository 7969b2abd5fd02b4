"""Several models at once: how often intervals hold the analytic value, and what using the pilot again does to the mean.

python benchmarks/multifidelity.py [--seeds 400]

Ishigami's function with the cheaper versions of Qian and others (2018), and a skewed function whose split follows from a
pilot that is part of its samples.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from scipy.special import stdtrit

from tripod_doe.analyses.multifidelity.estimates import Estimate, estimate
from tripod_doe.analyses.multifidelity.multifidelity import half_of_total
from tripod_doe.analyses.multifidelity.quantiles import quantiles

_PARTS = {"1": 0.5 * (1 + 0.1 * np.pi**4 / 5) ** 2, "2": 49 / 8, "13": 8 * 0.01 * np.pi**8 / 225}
VARIANCE = sum(_PARTS.values())
FIRST = np.array([_PARTS["1"], _PARTS["2"], 0]) / VARIANCE
TOTAL = np.array([_PARTS["1"] + _PARTS["13"], _PARTS["2"], _PARTS["13"]]) / VARIANCE
MODELS = ((7, 0.1, 4), (6.65, 0.1, 4), (4.2, 0.9, 2))
MEDIAN = 3.544  # from two million points


def ishigami(x: np.ndarray, a: float, b: float, power: int) -> np.ndarray:
    return np.sin(x[..., 0]) + a * np.sin(x[..., 1]) ** 2 + b * x[..., 2] ** power * np.sin(x[..., 0])


def blocks(seed: int, count: int) -> np.ndarray:
    """Saltelli's blocks of three factors from -pi to pi, shape (sample, point, factor)."""
    first, last = np.pi * (2 * np.random.default_rng(seed).random((count, 2, 3)).transpose(1, 0, 2) - 1)
    mixed = []
    for factor in range(3):
        each = first.copy()
        each[:, factor] = last[:, factor]
        mixed.append(each)
    return np.stack([first, *mixed, last], axis=1)


def holds(found: Estimate, truth: float, logarithmic: bool = False) -> bool:
    half = stdtrit(min(found.freedom, 1e9), 0.975) * math.sqrt(found.variance)
    if logarithmic:
        half = found.value * math.expm1(half / found.value)
    return abs(found.value - truth) <= half


def holds_total(found: Estimate, truth: float) -> bool:
    return abs(found.value - truth) <= half_of_total(found, 0.95)


def coverage(seeds: int) -> None:
    """Share of the 95 % intervals that hold the truth."""
    print(f"{'samples':>18} {'mean':>6} {'var.':>6} {'S1':>6} {'ST':>6} {'median':>7}")
    for counts in ((16, 64, 512), (32, 128, 1024), (64, 256, 2048), (48, 1500, 20000)):
        hits: dict[str, list[bool]] = {key: [] for key in ("mean", "variance", "S1", "ST", "median")}
        for seed in range(seeds):
            x = blocks(seed, counts[-1])
            values = [ishigami(x[:count], *model) for count, model in zip(counts, MODELS, strict=True)]
            found = estimate(values)
            hits["mean"].append(holds(found.mean, 3.5))
            hits["variance"].append(holds(found.variance, VARIANCE, logarithmic=True))
            hits["S1"] += [holds(each, truth) for each, truth in zip(found.first, FIRST, strict=True)]
            hits["ST"] += [holds_total(each, truth) for each, truth in zip(found.total, TOTAL, strict=True)]
            ends = quantiles([each[:, [0, -1]] for each in values], [0.5], 1.96)
            hits["median"].append(bool(ends[1, 0] <= MEDIAN <= ends[2, 0]))
        told = [f"{100 * np.mean(each):6.1f}" for each in hits.values()]
        print(f"{counts!s:>18} {' '.join(told)} %", flush=True)


def like_third(u: np.ndarray, model: int) -> np.ndarray:
    """A product, as the third order of a joint over torque, angle and friction; cheaper models leave out parts of it."""
    torque, angle, friction = 25 + 75 * u[..., 0], 0.5 + u[..., 1], 0.03 + 0.04 * u[..., 2]
    if model == 2:
        return torque * angle * friction
    more = (0.02, 0.018)[model] * angle
    scale = 0.97 if model else 1 + 0.1 * np.sin(3 * u[..., 2])
    return scale * torque * angle**1.3 * (friction + more)


def like_second(u: np.ndarray, model: int) -> np.ndarray:
    """A magnitude, as the second order of a joint over two skews and the torque."""
    own, other = u[..., 0] - 0.5, u[..., 1] - 0.5
    return np.abs(own + (0.6, 0.7, 0.0)[model] * other) * (0.3 + u[..., 2])


def skewed_totals(seeds: int) -> None:
    """Share of the 95 % intervals of total indices that hold those of 100,000 samples of the truth, symmetric and stated."""
    for function in (like_third, like_second):
        wanted = [each.value for each in estimate([function((blocks(999, 100_000) / np.pi + 1) / 2, 0)]).total]
        for counts in ((16, 64, 512), (48, 200, 1600)):
            hits = []
            for seed in range(100, 100 + seeds):
                u = (blocks(seed, counts[-1]) / np.pi + 1) / 2
                found = estimate([function(u[:count], model) for model, count in enumerate(counts)]).total
                pairs = list(zip(found, wanted, strict=True))
                hits.append([[holds(*pair) for pair in pairs], [holds_total(*pair) for pair in pairs]])
            plain, stated = (np.round(100 * each).astype(int).tolist() for each in np.mean(hits, axis=0))
            print(f"{function.__name__:>12} {counts!s:>18}: symmetric {plain} %, stated {stated} %", flush=True)


def pilot_again(seeds: int) -> None:
    """Bias of mean and variance of a skewed function over their standard errors, with the split from 24 of 48 samples."""
    samples, pilot, price = 48, 24, 0.05
    mean, variance = math.gamma(2.5), math.gamma(4) - math.gamma(2.5) ** 2 + 0.64
    off = []
    for seed in range(seeds):
        z = np.random.default_rng(seed).exponential(size=(1200, 2))
        truth, cheap = z[:, :1] ** 1.5 + 0.8 * (z[:, 1:] - 1), z[:, :1]
        explained = np.corrcoef(truth[:pilot, 0], cheap[:pilot, 0])[0, 1] ** 2
        explained = np.clip(1 - (1 - explained) * (pilot - 1) / (pilot - 2), 0, 0.999)
        count = min(math.ceil(samples * math.sqrt(explained / (price * (1 - explained)))), 1200)
        found = estimate([truth[:samples], cheap[:count]] if count > samples else [truth[:samples]])
        off.append((found.mean.value - mean, found.variance.value - variance))
    bias = np.mean(off, axis=0) / np.std(off, axis=0)
    print(f"bias over standard error: mean {bias[0]:.3f}, variance {bias[1]:.3f}; +- {2 / math.sqrt(seeds):.3f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=400, help="repetitions of each case")
    chosen = parser.parse_args().seeds
    coverage(chosen)
    skewed_totals(max(chosen // 4, 1))
    pilot_again(10 * chosen)
