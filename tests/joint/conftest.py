from __future__ import annotations

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.joint.multibody.joint_scene import build_joint
from tripod_doe.joint.simulator import simulator
from tripod_doe.joint.unit_conversion import internal_values
from tripod_doe.mechanics.assembly import assemble


@pytest.fixture(scope="session")
def internal_points():
    """A block of points from named parameters; arrays give several points."""

    def make(**given):
        count = max((np.size(value) for value in given.values()), default=1)
        columns = {name: np.broadcast_to(np.asarray(value, float), (count,)) for name, value in given.items()}
        full = simulator.columns({"relative_tolerance": 1e-11}, columns, count)
        return internal_values(full)

    return make


@pytest.fixture(scope="session")
def joint_values(internal_points):
    """Values of one operating point."""

    def make(**given):
        return internal_points(**given).point(0)

    return make


@pytest.fixture(scope="session")
def joint_assembly(joint_values):
    """The assembled scene of one operating point."""

    def make(needles, **given):
        return assemble(build_joint(joint_values(**given), needles))

    return make


@pytest.fixture(scope="session")
def simulated():
    """One point by a multibody model as plain arrays by output, with outcome and detail; each is run once."""
    answers = {}

    def simulate(**given):
        given = {"model": "rollers", **given}
        key = tuple(sorted(given.items()))
        if key not in answers:
            answers[key] = td.simulate(**given)
        return answers[key]

    return simulate
