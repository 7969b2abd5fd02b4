"""The split of the thrust: it adds up, its terms are those of the balance, and no model splits in a way of its own."""

from __future__ import annotations

import numpy as np
import pytest
from few import FEW
from scipy.spatial.transform import Rotation

import tripod_doe as td
from tripod_doe.joint.multibody.thrust_and_power import groove_readings
from tripod_doe.joint.multibody.thrust_parts import thrust_parts
from tripod_doe.joint.outputs import PARTS
from tripod_doe.mechanics.solve.equations_of_motion import evaluate

BALANCE = {"model": "equilibrium", "relative_tolerance": 1e-11}
SKEWS = {"initial_skew_1_deg": 0.4, "initial_skew_2_deg": -0.3, "initial_skew_3_deg": 2.0}


def _moving(assembly, count=4):
    """States at random velocities about the start: every contact that touches slips, rolls and spins."""
    state, random = assembly.initial_state(), np.random.default_rng(5)
    velocities = np.stack([state.velocities] * count)
    velocities[:, 1:] += random.normal(0, 5, velocities[:, 1:].shape)
    return 1e-4 * np.arange(count), np.stack([state.positions] * count), velocities


@pytest.mark.parametrize("needles", [False, True])
def test_parts_add_up_to_the_thrust_of_every_groove(joint_assembly, joint_values, needles):
    """Exact physics: in any state of motion; to rounding of the normal force, 800 N."""
    assembly, values = joint_assembly(needles, **FEW, **SKEWS), joint_values(**FEW, **SKEWS)
    times, positions, velocities = _moving(assembly)
    parts = thrust_parts(assembly, times, positions, velocities, values)
    thrust, _ = groove_readings(assembly, positions, velocities)
    assert parts.shape == (len(PARTS), 3, len(times))
    assert np.abs(parts).max(axis=(1, 2)).min() > 1e-3
    assert parts.sum(axis=0) == pytest.approx(thrust, abs=1e-11)


@pytest.mark.parametrize("off", PARTS[1:5])
def test_a_mechanism_without_friction_has_no_part(joint_assembly, joint_values, off):
    """Exact physics: zero coefficient, zero part, in any state of motion."""
    given = {**FEW, **SKEWS, off: 0}
    assembly = joint_assembly(False, **given)
    parts = thrust_parts(assembly, *_moving(assembly), joint_values(**given))
    assert np.abs(parts[PARTS.index(off)]).max() == 0
    gone = 2 if off == "needle_sliding" else 1  # what does not slide passes no rolling resistance on
    assert np.abs(parts).max(axis=(1, 2)).astype(bool).sum() == len(PARTS) - gone


def test_the_remainder_is_the_inertia_of_the_rollers(joint_assembly, joint_values):
    """Exact physics: what a roller's moments leave is I dw/dt about its axis, by the accelerations of Eq. 1.

    To rounding of the needles' normal forces, 800 N that pass the axis; the engine knows nothing of the split.
    """
    given = {**FEW, **SKEWS}
    assembly, values = joint_assembly(False, **given), joint_values(**given)
    times, positions, velocities = _moving(assembly)
    rest, work = thrust_parts(assembly, times, positions, velocities, values)[-1], assembly.work()
    for s in range(len(times)):
        evaluate(assembly.tables, work, positions[s], velocities[s], 0.0, 0.0)
        for k in range(3):
            roller, groove = assembly.names.index(f"roller {k + 1}"), assembly.tables.contacts[-3 + k]
            axis = Rotation.from_quat(positions[s, roller, 3:], scalar_first=True).apply([0.0, 0.0, 1.0])
            normal = groove["point"] - positions[s, roller, :3]
            normal[2] = 0.0
            lever = values.roller_radius * np.cross(axis, normal / np.linalg.norm(normal))
            turn = velocities[s, roller, 3:]
            rate = work.acceleration[roller, 3:] @ axis + np.cross(turn, axis) @ assembly.tables.frame
            inertia = assembly.tables.bodies["inertia"][roller, 2]
            assert rest[k, s] == pytest.approx(inertia * rate * lever[2] / (lever @ lever), abs=1e-9)


def _orders(result, order):
    """Complex amplitudes of all parts, and of the thrust, at one order."""
    turn = np.exp(1j * np.radians(result["thrust_part_phase_deg"].sel(order=order)))
    whole = np.exp(1j * np.radians(result["thrust_phase_deg"].sel(order=order)))
    return (result["thrust_part_amplitude"].sel(order=order) * turn).values, complex(
        (result["thrust_amplitude"].sel(order=order) * whole).values
    )


@pytest.mark.parametrize("given", [{"model": "equilibrium"}, {}, {"model": "rollers", "cycles": 2}])
def test_orders_of_the_parts_add_up_to_those_of_the_thrust(given):
    """Exact physics: orders are linear, so phases count and the sum is exact."""
    result = td.simulate(**given, initial_skew_1_deg=0.4, initial_skew_2_deg=-0.4)
    for order in range(13):
        parts, whole = _orders(result, order)
        assert parts.sum() == pytest.approx(whole, abs=1e-9)


@pytest.mark.parametrize("off", PARTS[1:5])
def test_equilibrium_gives_no_part_without_friction_and_no_remainder(off):
    """Exact physics: a balance without inertia leaves its tolerance, 1e-11 of the moments of 14 N, with room of 1e2."""
    parts, _ = _orders(td.simulate(**BALANCE, initial_skew_1_deg=2, **{off: 0}), 3)
    assert abs(parts[PARTS.index(off)]) == 0
    assert abs(parts[-1]) < 1e-8


def test_the_split_does_not_know_which_groove_is_the_first():
    """Invariance: skews that move on by a groove move the rotation angle by 120 deg; the third order stays."""
    skews = 0.4, -0.2, 1.0
    moved = [
        td.simulate(**BALANCE, **{f"initial_skew_{k + 1}_deg": skews[(k + by) % 3] for k in range(3)})
        for by in range(2)
    ]
    assert _orders(moved[0], 3)[0] == pytest.approx(_orders(moved[1], 3)[0], abs=1e-8)


HEAVY = FEW | {"cycles": 3, "torque_n_m": 150}
"""Under which few needles rattle less."""


@pytest.mark.slow
def test_needles_split_the_thrust_as_their_lumped_bearing_does(simulated):
    """Limit: the third order of all parts but the needles' sliding, which lacks neighbours in a lumped bearing.

    Within 2 % of the third order: the models differ by 1.6 % there, and in the clearance's effect on the load.
    """
    given = HEAVY | {"initial_skew_1_deg": 0.4}  # as in test_multibody_run, where it runs, too
    needles, rollers = (_orders(simulated(model=model, **given), 3) for model in ("needles", "rollers"))
    gaps = np.abs(needles[0] - rollers[0]) / abs(rollers[1])
    assert np.delete(gaps, PARTS.index("needle_sliding")).max() < 0.02
    assert needles[0].sum() == pytest.approx(needles[1], abs=1e-9)


@pytest.mark.slow
def test_needles_without_sliding_friction_have_no_part_of_it():
    """Limit: found as what the balance leaves, it is zero to the run's own numerical error of the third order."""
    result = td.simulate(model="needles", needle_sliding=0, **HEAVY, relative_tolerance=2e-3)
    part = float(result["thrust_part_amplitude"].sel(part="needle_sliding", order=3))
    assert part < 3 * float(result["thrust_amplitude_error"].sel(order=3)) + 0.01
