"""What limits a step, computed from a scene, against the same by hand (exact physics)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from example_scenes import pendulum

import tripod_doe as td
from tripod_doe.mechanics import scene as parts
from tripod_doe.mechanics.assembly import State, assemble
from tripod_doe.mechanics.integrators.monitor import Settings, begin_watch
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.scenes.needle_between_plates import build, closed_form, simulator, transition_velocity
from tripod_doe.mechanics.stability.linearisation import fastest_rates, linear_matrices, rates_at
from tripod_doe.mechanics.stability.rates import RATE_OUTPUTS

EXACT = 1e-9  # eigenvalues of small well-scaled matrices: rounding


def _needle(**values):
    full = {k: float(v) for k, v in simulator.effective(values).items() if isinstance(v, int | float)}
    assembly = assemble(build(full))
    state = assembly.initial_state()
    state.velocities[:] = 0.0  # no slip anywhere: friction is steepest
    return full, assembly, state


def test_stiffest_mode_of_a_needle_between_plates():
    """A needle on two line contacts; the plate above is free along the normal, too: two masses on two springs."""
    values, assembly, state = _needle(friction_a=0.0, friction_b=0.0)
    count, length = 7, values["needle_length_mm"]
    stiffness = 8.15e4 * length ** (8 / 9)  # Table 1, all spheres
    spring = 10 / 9 * values["load_n"] / (values["load_n"] / stiffness) ** 0.9  # slope of C d^(10/9)
    mass = values["density_kg_m3"] * 1e-12 * math.pi * length
    plate = 1e-4
    normal = np.linalg.eigvals([[2 * spring / mass, -spring / mass], [-spring / plate, spring / plate]]).max()
    along = length**2 * (1 - 1 / count**2) / 12  # mean square of the spheres' places
    tilting = 2 * spring * along / (mass * (1 / 4 + length**2 / 12))
    found = rates_at(linear_matrices(assembly, state), 10.0).contact
    assert found == pytest.approx(math.sqrt(max(normal, tilting)), rel=EXACT)


def test_friction_relaxes_a_needle_by_its_lever():
    """Sliding at mu f_n / (v_st m) on both plates; turning about its axis faster by the lever, m r^2 / I = 2."""
    values, assembly, state = _needle(friction_a=0.03, friction_b=0.03, contact_damping_s_per_mm=0.0)
    mass = values["density_kg_m3"] * 1e-12 * math.pi * values["needle_length_mm"]
    slide = 2 * 0.03 * values["load_n"] / (transition_velocity(values) * mass)
    matrices = linear_matrices(assembly, state)
    rates = np.linalg.eigvals(np.linalg.solve(matrices.mass, matrices.tangent)).real
    assert rates.max() == pytest.approx(2 * slide, rel=EXACT)
    assert np.abs(rates / slide - 1).min() < EXACT  # along the axis
    assert rates_at(matrices, 10.0).friction == pytest.approx(2 * slide, rel=EXACT)


def _block(speed: float):
    """A block that may slide along x only, at some speed over its transition velocity of 1 mm/s."""
    body = parts.Body(
        "block",
        1e-3,
        (1.0, 1.0, 1.0),
        position=(0.0, 0.0, 0.99),
        velocity=(speed, 0.0, 0.0),
        locked=(False, True, True, True, True, True),
    )
    friction = parts.Friction(0.1, 1.0)
    touch = parts.SphereRow("block", parts.Plane(parts.GROUND), 1.0, 1e4, exponent=1.0, friction=friction)
    return assemble(parts.Scene((body,), contacts=(touch,)))


@pytest.mark.parametrize("speed", [0.0, 0.5, 2.0])
def test_lag_of_the_secant(speed):
    """One slope: the response to a change at the pace P is T + i P m, and the secant adds S - T to it."""
    assembly, pace, load = _block(speed), 50.0, 0.1 * 100.0
    tangent = load / math.cosh(speed) ** 2
    secant = load * (math.tanh(speed) / speed if speed else 1.0)
    rates = rates_at(linear_matrices(assembly), pace)
    assert rates.friction == pytest.approx(tangent / 1e-3, rel=EXACT)
    expected = pace * (secant - tangent) / abs(tangent + 1j * pace * 1e-3)
    assert rates.lag == pytest.approx(expected, rel=1e-9, abs=1e-9 * secant)


def test_constraints_leave_their_motions_only():
    """A horizontal pendulum: no force falls as it moves, and its one motion has the mass m l^2 / l^2."""
    assembly = assemble(pendulum())
    matrices = linear_matrices(assembly)
    assert matrices.mass.shape[0] == 6 - assembly.tables.rows.size
    assert np.linalg.eigvalsh(matrices.mass) == pytest.approx(1.0)


def test_the_way_counts_by_its_fastest_state_and_its_mean_lag():
    assembly = _block(0.0)
    states = []
    for speed in (0.0, 2.0):
        state = assembly.initial_state()
        state.velocities[1, 0] = speed
        states.append(State(0.0, state.positions, state.velocities))
    both = fastest_rates(assembly, states, 50.0)
    one, other = (rates_at(linear_matrices(assembly, state), 50.0) for state in states)
    assert both.friction == one.friction > other.friction
    assert both.lag == pytest.approx((one.lag + other.lag) / 2)


@pytest.mark.parametrize("name", [name for name, method in METHODS.items() if method.explicit])
def test_explicit_methods_reach_as_far_as_they_say(name):
    """On u' = -c u the method is stable just below its real reach and not just above: exact mathematics."""
    friction = parts.Friction(0.1, 1e6)  # so wide that friction is linear
    body = parts.Body(
        "block",
        1e-3,
        (1.0, 1.0, 1.0),
        position=(0.0, 0.0, 0.99),
        velocity=(1.0, 0.0, 0.0),
        locked=(False, True, True, True, True, True),
    )
    touch = parts.SphereRow("block", parts.Plane(parts.GROUND), 1.0, 1e4, exponent=1.0, friction=friction)
    assembly = assemble(parts.Scene((body,), contacts=(touch,)))
    rate = rates_at(linear_matrices(assembly), 1.0).friction
    ends = []
    for share in (0.99, 1.01):
        state, work, count = assembly.initial_state(), assembly.work(), 400
        begin_watch(assembly.tables, work, state.positions, state.velocities, 0.0)
        end = count * share * METHODS[name].reach[0] / rate
        METHODS[name].integrate(
            assembly.tables, work, state.positions, state.velocities, np.zeros(3), end, count, Settings()
        )
        ends.append(abs(state.velocities[1, 0]))
    assert ends[0] < 1 < ends[1]


def test_rates_are_outputs_on_request_only():
    rates = {output.name for output in RATE_OUTPUTS}
    point = {name: np.array([value], object) for name, value in simulator.effective({"duration_s": 0.1}).items()}
    kept = simulator.simulate(point, ["axial_drift_mm", *sorted(rates)]).outputs
    values = {k: float(v) for k, v in simulator.effective({"duration_s": 0.1}).items() if isinstance(v, int | float)}
    slip, v_st = closed_form(values)[0], transition_velocity(values)
    along = values["plate_speed_mm_s"] * math.sin(math.radians(values["skew_deg"]))
    mass = values["density_kg_m3"] * 1e-12 * math.pi * values["needle_length_mm"]
    chords = [
        mu * values["load_n"] * math.tanh(v / v_st) / v
        for mu, v in ((values["friction_a"], slip), (values["friction_b"], along - slip))
    ]
    # steady motion: turning about its axis, a needle slips across its slip, where a friction law's slope is its chord;
    # sliding across couples in as the chords differ, so the rate lies above that of turning alone
    turning = 2 * sum(chords) / mass
    coupled = np.linalg.eigvals(
        np.array([[sum(chords), chords[1] - chords[0]], [2 * (chords[1] - chords[0]), 2 * sum(chords)]]) / mass
    ).max()
    assert turning < coupled
    assert kept["friction_rate_per_s"].data[0] == pytest.approx(coupled, rel=1e-3)  # contact damping is in it, too
    assert kept["secant_lag_rate_per_s"].data[0] > 0
    assert all(simulator.outputs[name].on_request for name in rates)
    assert rates.isdisjoint(td.simulate("needle-between-plates", duration_s=1e-3).data_vars)
