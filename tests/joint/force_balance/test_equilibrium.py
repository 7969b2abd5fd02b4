"""The equilibrium model: its oracle, its exact limits, its symmetries, and the paper's findings that it can show."""

from __future__ import annotations

import numpy as np
import pytest
from reference import groove_thrust

from tripod_doe.joint.derived_constants.load_zone import bearing_load_zone
from tripod_doe.joint.force_balance.equilibrium import solve_equilibrium
from tripod_doe.joint.geometry.transition_velocities import transition_velocities
from tripod_doe.joint.orders import complex_amplitudes

SKEWS = ("initial_skew_1_deg", "initial_skew_2_deg", "initial_skew_3_deg")
FRICTIONLESS_PARTS = {"groove_rolling": 0, "needle_rolling": 0, "groove_spinning": 0, "needle_sliding": 0}


@pytest.fixture(scope="module")
def solve(internal_points):
    def run(samples=360, **given):
        return solve_equilibrium(internal_points(**given), samples)

    return run


@pytest.fixture(scope="module")
def orders(solve):
    """Complex order amplitudes of (sum, groove), of the first point."""

    def run(**given):
        result = solve(**given)
        assert result.settled.all()
        of_groove = complex_amplitudes(result.groove_thrust)[0]
        return of_groove.sum(axis=0), of_groove

    return run


def skews(*values):
    return dict(zip(SKEWS, values, strict=True))


@pytest.mark.parametrize("seed", range(6))
def test_kernel_agrees_with_the_slow_reference(internal_points, solve, seed):
    """Exact physics against the independent oracle; 1e-6 is what its finite differences leave."""
    rng = np.random.default_rng(seed)
    given = {
        "joint_angle_deg": rng.uniform(3, 20),
        "torque_n_m": rng.choice([-1, 1]) * rng.uniform(20, 200),
        "speed_rpm": rng.uniform(100, 2000),
        "groove_sliding_friction": rng.uniform(0.03, 0.1),
        "groove_spin_friction": rng.uniform(0, 0.1),
        "needle_sliding_friction": rng.uniform(0, 0.06),
        "groove_rolling_friction": rng.uniform(0, 0.004),
        "roller_radius_mm": rng.uniform(13, 18),
        "bearing_radial_clearance_mm": rng.choice([0, 0.015]),
        "transition_ratio": rng.uniform(0.2, 0.5),
        **skews(*rng.uniform(-3, 3, 3)),
    }
    p = internal_points(**given).point(0)
    transition = transition_velocities(p)
    load = abs(p.torque) / (3 * p.pitch_radius)
    bearing = p.needle_pitch_diameter / 2
    needle = p.needle_diameter / 2
    clearance = p.bearing_radial_clearance
    reference = {
        "theta": p.joint_angle,
        "omega": p.speed,
        "torque": p.torque,
        "pitch": p.pitch_radius,
        "radius": p.roller_radius,
        "mu": p.groove_sliding_friction,
        "mu_spin": p.groove_spin_friction,
        "mu_r": p.groove_rolling_friction,
        "mu_n": p.needle_sliding_friction,
        "mu_rn": p.needle_rolling_friction,
        "lever": p.groove_rolling_lever,
        "axis_factor": p.groove_axis_factor,
        "kappa": bearing_load_zone(load, clearance, p.needle_stiffness, p.needle_count)[0],
        "needle_lever": (bearing + needle + clearance) * (bearing - needle) / bearing,
        "bearing_radius": bearing,
        "skew": p.initial_skews,
        "v_groove": float(transition.groove_slip),
        "v_needle": float(transition.needle_slip),
        "w_roll": float(transition.groove_roll),
        "w_bearing": float(transition.roller_spin),
        "w_normal": float(transition.groove_spin),
    }
    result = solve(samples=36, **given)
    for sample in (0, 5, 13, 22, 31):
        expected = groove_thrust(2 * np.pi * sample / 36, reference)
        assert result.groove_thrust[0, :, sample] == pytest.approx(expected, rel=1e-6, abs=1e-6 * load)


def test_energy_balance_closes_to_rounding(solve):
    """Exact physics: input = output + friction power, at random operating points."""
    rng = np.random.default_rng(1)
    result = solve(
        joint_angle_deg=rng.uniform(2, 25, 50),
        torque_n_m=rng.uniform(-200, 200, 50),
        initial_skew_1_deg=rng.uniform(-3, 3, 50),
        groove_rolling_friction=rng.uniform(0, 0.004, 50),
    )
    assert result.settled.all()
    assert np.abs(result.energy_residual).max() < 1e-8
    assert (result.friction_power >= 0).all()


def test_reference_point(orders):
    """Published numbers: full model between 14 and 15 N (FACTS); sum is three times the groove; order 1 cancels."""
    total, groove = orders()
    assert 14 < abs(total[3]) < 15
    assert np.abs(total[[1, 2]]).max() < 1e-9 * abs(total[3])
    assert abs(total[3]) == pytest.approx(3 * abs(groove[0, 3]), rel=1e-12)
    assert abs(groove[0, 1]) > abs(groove[0, 3])


def test_sharp_limit_is_coulombs(orders):
    """Exact physics: 3 (2/pi) mu N sin theta, and order 1 of a groove equal to its order 3; 1 % is left to the slip
    across the groove and to the normal forces, which the closed form takes for constant. With more friction the contact
    angle makes two balances possible where a roller turns back, which the closed form leaves out, too."""
    total, groove = orders(transition_ratio=1e-4, groove_sliding_friction=0.02, **FRICTIONLESS_PARTS)
    load = 50e3 / (3 * 21)
    assert abs(total[3]) == pytest.approx(6 / np.pi * 0.02 * load * np.sin(np.radians(10)), rel=0.01)
    assert abs(groove[0, 1]) == pytest.approx(abs(groove[0, 3]), rel=0.01)


@pytest.mark.parametrize("samples", [360, 1800])
def test_where_two_balances_are_possible_a_roller_stays_in_the_one_it_came_by(solve, samples):
    """Invariance: it turns back at the same angles however many samples there are. Regression: it went to and fro."""
    thrust = solve(samples, transition_ratio=1e-4, groove_sliding_friction=0.05, **FRICTIONLESS_PARTS).groove_thrust
    turns = [np.flatnonzero(np.diff(np.sign(each))) * 360 / samples for each in thrust[0]]
    np.testing.assert_allclose(turns[0], [19, 90, 90, 108.5, 199, 270, 270, 288.5], atol=1)


def test_torque_scales_every_order_exactly_where_the_model_is_linear(orders):
    """Exact: without spinning (N^(4/3)) and bearing clearance (load zone) all is proportional to the torque."""
    linear = {"groove_spinning": 0, "bearing_radial_clearance_mm": 0, **skews(1, -1, 0.5)}
    single, groove = orders(torque_n_m=50, **linear)
    _, groove_double = orders(torque_n_m=100, **linear)
    np.testing.assert_allclose(groove_double, 2 * groove, rtol=1e-9, atol=1e-9 * abs(single[3]))
    full, _ = orders(torque_n_m=50)
    full_double, _ = orders(torque_n_m=100)
    assert abs(full_double[3]) == pytest.approx(2 * abs(full[3]), rel=0.01)


def test_speed_changes_nothing(orders):
    """Exact: all transition velocities follow the speed; rounding and the tolerance remain."""
    slow, _ = orders(speed_rpm=60, **skews(1, -1, 1))
    fast, _ = orders(speed_rpm=2000, **skews(1, -1, 1))
    np.testing.assert_allclose(fast, slow, rtol=0, atol=1e-8 * abs(slow[3]))


def test_second_order_follows_uneven_skew(orders):
    """Published findings (3.4): none for equal skews, turned by 180 deg when all are reversed, none without needle
    sliding; proportional to a small skew, so independent of the joint angle at equal skew within the paper's range."""
    uneven, _ = orders(**skews(0.4, -0.4, 0.4))
    reversed_, _ = orders(**skews(-0.4, 0.4, -0.4))
    equal, _ = orders(**skews(0.4, 0.4, 0.4))
    sharp, _ = orders(needle_sliding=0, **skews(0.4, -0.4, 0.4))
    assert abs(uneven[2]) > 0.1
    assert reversed_[2] == pytest.approx(-uneven[2], rel=1e-6)
    assert abs(equal[2]) < 1e-9 * abs(uneven[3])
    assert abs(sharp[2]) < 1e-9 * abs(uneven[3])
    steep, _ = orders(joint_angle_deg=14, **skews(0.4, -0.4, 0.4))
    assert abs(steep[2]) == pytest.approx(abs(uneven[2]), rel=0.05)


def test_mirrored_torque_mirrors_the_thrust(solve):
    """Exact symmetry: mirror in the plane of both axes and let time run back; friction and torque change sign, so
    thrust(-T, phi) follows from the mirrored slip. Without feedback of friction on the loads this holds exactly;
    with it the two thirds orders differ by the friction's part of the normal forces, a few per cent."""
    drive = solve(torque_n_m=50).groove_thrust[0, 0]
    coast = solve(torque_n_m=-50).groove_thrust[0, 0]
    mirrored = -np.roll(drive[::-1], 1)
    assert np.abs(coast - mirrored).max() < 0.35 * np.abs(drive).max()
    small = {
        "groove_sliding_friction": 1e-4,
        "needle_sliding_friction": 1e-4,
        "groove_rolling_friction": 4e-6,
        "needle_rolling_friction": 4e-6,
    }
    drive = solve(torque_n_m=50, **small).groove_thrust[0, 0]
    coast = solve(torque_n_m=-50, **small).groove_thrust[0, 0]
    np.testing.assert_allclose(coast, -np.roll(drive[::-1], 1), atol=2e-3 * np.abs(drive).max())


def test_point_inversion_turns_a_groove_by_half_a_turn(solve):
    """Exact symmetry: g(phi + 180 deg; psi) = -g(phi; -psi)."""
    forward = solve(**skews(2, -1, 0.5)).groove_thrust[0]
    backward = solve(**skews(-2, 1, -0.5)).groove_thrust[0]
    np.testing.assert_allclose(np.roll(forward, 180, axis=1), -backward, atol=1e-7)


@pytest.mark.parametrize(
    "limit", [{"torque_n_m": 0}, {"joint_angle_deg": 0}, {"speed_rpm": 0}, {"groove_sliding": 0, "groove_rolling": 0}]
)
def test_limits_without_thrust(solve, limit):
    """Exact: no torque, no angle, no speed or no friction at the groove, no thrust; nothing is NaN."""
    result = solve(**limit)
    assert result.settled.all()
    assert np.abs(result.groove_thrust).max() < 1e-6
    assert np.isfinite(result.energy_residual).all()


def test_third_order_grows_linearly_with_the_joint_angle(orders):
    """Published finding (3.3); the offset of 1.5-2 N is the rolling resistances' (FACTS)."""
    angles = np.arange(4, 15)
    amplitude = [abs(orders(joint_angle_deg=float(angle))[0][3]) for angle in angles]
    slope, offset = np.polyfit(angles, amplitude, 1)
    assert np.corrcoef(angles, amplitude)[0, 1] ** 2 > 0.999
    assert 1.1 < slope < 1.4
    assert 1.5 < offset < 2.1


def test_a_point_does_not_depend_on_its_block(solve):
    """Invariance: bit by bit the same alone and among others."""
    rng = np.random.default_rng(2)
    given = {"joint_angle_deg": rng.uniform(2, 20, 7), "torque_n_m": rng.uniform(10, 100, 7)}
    together = solve(**given).groove_thrust
    for point in range(7):
        alone = solve(**{name: values[point] for name, values in given.items()}).groove_thrust
        assert np.array_equal(alone[0], together[point])
