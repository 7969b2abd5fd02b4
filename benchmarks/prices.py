"""What an answer of each model costs, and the look at vibrations beside it, in CPU time: all in turns, round after round.

    python benchmarks/prices.py [--rounds 7] [--joints 100] [--multibody 3] [--only balances]

The joints are the first of ordinary_joints.py, spread over their field, the outputs those that a study keeps unless it
names others. `kinetostatic` is told without a look at vibrations, with that at joints that may vibrate (as studies have
it), and with one at every joint; `needles` at the reference joint stands beside its plain run: fixed steps of 2e-5 s by
`bdf2`, one linear solve each, without a look at vibrations, checks, or a second run for the error. Lines give the median, and the quartiles of
rounds; ratios are those of the same round, since other work on the machine burdens what runs at the same time alike.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from ordinary_joints import drawn_joints

from tripod_doe.joint.models.registry import MODELS
from tripod_doe.joint.multibody.joint_scene import build_joint
from tripod_doe.joint.outputs import JOINT_OUTPUTS, VIBRATES, VIBRATION_THIRD
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.joint.simulator import simulator
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.run import Limits, run

USUAL = tuple(name for name, output in JOINT_OUTPUTS.items() if not output.on_request)
CALM = tuple(name for name in USUAL if name not in (VIBRATES, VIBRATION_THIRD))
PLAIN_STEP = 2e-5
RATIOS = (
    ("kinetostatic", "equilibrium"),
    ("kinetostatic, look where one may vibrate", "kinetostatic"),
    ("kinetostatic, look at all", "kinetostatic"),
    ("needles, reference joint", "plain bdf2"),
)
"""Prices told over others: of the looks, what they add."""


def of_joints(model: str, count: int, keep: tuple[str, ...]) -> float:
    """CPU milliseconds a joint of a block of ordinary ones."""
    drawn = drawn_joints(count)
    columns = simulator.columns({"model": model}, drawn, count)
    wanted = [name for name in keep if name in MODELS[model].outputs]
    began = time.process_time()
    simulator.simulate(columns, wanted)
    return 1e3 * (time.process_time() - began) / count


def of_reference(model: str) -> float:
    """CPU milliseconds of the reference joint."""
    columns = simulator.columns({"model": model}, {}, 1)
    began = time.process_time()
    simulator.simulate(columns, [name for name in USUAL if name in MODELS[model].outputs])
    return 1e3 * (time.process_time() - began)


def of_plain_run() -> float:
    """CPU milliseconds of the reference joint by fixed steps, and nothing else."""
    values = point_values({}).point(0)
    began = time.process_time()
    assembly = assemble(build_joint(values, needles=True))
    turns = int(values.cycles)
    run(
        assembly,
        "bdf2",
        2 * math.pi / values.speed * turns,
        step=PLAIN_STEP,
        samples=turns * int(JOINT_PARAMETERS["samples_per_revolution"].default),
        settings=Settings(correction=math.inf),
        limits=Limits(energy=math.inf, reversals=math.inf, drift=math.inf, windows=0),
    )
    return 1e3 * (time.process_time() - began)


def measured(prices: dict[str, Callable[[], float]], rounds: int) -> dict[str, np.ndarray]:
    """Prices of all rounds after one that compiles."""
    found = [[price() for price in prices.values()] for _ in range(rounds + 1)][1:]
    return dict(zip(prices, np.array(found).T, strict=True))


def told(name: str, values: np.ndarray, unit: str) -> None:
    """Print the median and the quartiles of rounds."""
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
    print(f"{name}: {middle:.3g} ({low:.3g} to {high:.3g}){unit}", flush=True)


def main(given: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--joints", type=int, default=100)
    parser.add_argument("--multibody", type=int, default=3)
    parser.add_argument("--only", choices=["balances"])
    asked = parser.parse_args(given)
    prices: dict[str, Callable[[], float]] = {
        "equilibrium": partial(of_joints, "equilibrium", asked.joints, CALM),
        "kinetostatic": partial(of_joints, "kinetostatic", asked.joints, CALM),
        "kinetostatic, look where one may vibrate": partial(of_joints, "kinetostatic", asked.joints, USUAL),
        "kinetostatic, look at all": partial(
            of_joints, "kinetostatic", asked.joints, (*USUAL, "vibration_growth_rate_per_s")
        ),
    }
    if asked.only is None:
        prices |= {
            "rollers": partial(of_joints, "rollers", asked.multibody, USUAL),
            "needles, reference joint": partial(of_reference, "needles"),
            "plain bdf2": of_plain_run,
        }
    found = measured(prices, asked.rounds)
    for name, values in found.items():
        told(name, values, " CPU-ms")
    for name, other in RATIOS:
        if name in found:
            adds = name.startswith(f"{other},")
            told(f"{name} {'adds, ' if adds else ''}over {other}", found[name] / found[other] - adds, "")


if __name__ == "__main__":
    main()
