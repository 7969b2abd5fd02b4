"""A ring of needles: load zone of bearing handbooks, rolling of the cage, and every contact of a needle."""

import math

import numpy as np
import pytest
from needle_ring import needle_ring, pitch_radius

from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.run import run
from tripod_doe.mechanics.solve.equations_of_motion import generalized_forces
from tripod_doe.model_interface import Outcome


def _forces(assembly, state):
    work = assembly.work()
    generalized_forces(assembly.tables, work, state.positions, state.velocities)
    return work.force


def test_load_zone_without_clearance():
    """Published number: the most loaded of Z needles carries 4.08 F/Z (4.085 for m = 10/9)."""
    needles, shift = 81, 1e-3
    assembly = assemble(needle_ring(needles, preload=0.0, speed=0.0, gap=0.1))
    state = assembly.initial_state()
    state.positions[1, 0] += shift  # roller; every needle goes half way, so that both its contacts carry the same
    radial = state.positions[2:, :2] / np.linalg.norm(state.positions[2:, :2], axis=1)[:, None]
    state.positions[2:, :2] += 0.5 * shift * radial[:, :1] * radial
    force = _forces(assembly, state)
    stiffness = 7 * assembly.tables.contacts["stiffness"][0]
    most = stiffness * (0.5 * shift) ** (10 / 9)
    assert needles * most / abs(force[1, 0]) == pytest.approx(4.085, abs=0.005)
    # needles opposite to the load carry, and balance themselves to second order in the shift
    assert np.abs(force[2:, :2]).max() < 1e-3 * most


def test_neighbours_and_end_stops_push_apart():
    assembly = assemble(needle_ring(9, preload=-0.05, speed=0.0))
    state = assembly.initial_state()
    assert np.abs(_forces(assembly, state)).max() == 0.0  # clearance everywhere
    pitch = pitch_radius(9)
    angle = 0.012 / pitch  # more than the gap of 0.01 mm
    state.positions[2, :2] = pitch * np.array([math.cos(angle), math.sin(angle)])
    force = _forces(assembly, state)
    assert force[2, 1] < 0 < force[3] @ np.array([-math.sin(2 * math.pi / 9), math.cos(2 * math.pi / 9), 0, 0, 0, 0])
    state = assembly.initial_state()
    state.positions[2, 2] = 0.101
    force = _forces(assembly, state)
    assert force[2, 2] == pytest.approx(-assembly.tables.contacts["stiffness"][0] * 1e-3 ** (10 / 9), rel=1e-9)


def test_ring_rolls_at_the_speed_of_its_cage():
    """A free ring keeps rolling at r_b / (2 r_p) of the bore's speed, and no needle yaws or creeps along."""
    scene = needle_ring(9)
    result = run(assemble(scene), "bdf2", 5e-3, step=1e-5, samples=5)
    assert result.outcome == Outcome.FINISHED, result.detail
    pitch = pitch_radius(9)
    place = result.positions[-1, 2:, :2]
    turned = np.unwrap(np.arctan2(place[:, 1], place[:, 0]) - 2 * math.pi * np.arange(9) / 9, period=2 * math.pi)
    bore = pitch + 1.0 - 1e-3
    assert np.abs(place[:, 0] ** 2 + place[:, 1] ** 2 - pitch**2).max() < 1e-4
    expected = 20.0 * bore / (2 * pitch) * 5e-3
    np.testing.assert_allclose(turned % (2 * math.pi), expected, rtol=2e-3)
    assert np.abs(result.positions[-1, 2:, 2]).max() < 1e-9
