"""Needles that follow their roller: their law along known motions, and the balance with it against `needles`."""

from typing import NamedTuple

import numpy as np
import pytest

from tripod_doe.joint.force_balance.kinetostatic import solve_kinetostatic
from tripod_doe.joint.massless_needles.load_along_needle import (
    BORE,
    DEPTH,
    LEAN,
    PLACE,
    ROWS,
    SKEW,
    TRUNNION,
    UNKNOWN,
    VARIANCE,
    balance_unknown,
    follow_spread,
)
from tripod_doe.joint.massless_needles.load_sharing import NeedleLoads, NeedleSteps, RollerMotions, press_needles
from tripod_doe.joint.massless_needles.needle_constants import NeedleConstants, needle_constants, needle_constants_of
from tripod_doe.joint.massless_needles.needle_history import NeedleForces, follow_rollers
from tripod_doe.joint.massless_needles.needle_motion import RECORD, NeedleRing, _free_slip
from tripod_doe.joint.orders import complex_amplitudes
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH, load_three, spread, store
from tripod_doe.mechanics.compilation.kernels import kernel

SAMPLES = 360
PHI = np.linspace(0, 2 * np.pi, SAMPLES, endpoint=False)
LOAD = 800.0


class Found(NamedTuple):
    """What the needles of a trunnion do, the mean of the last two revolutions."""

    forces: np.ndarray
    moments: np.ndarray
    places: np.ndarray
    skew: float


def moved(skew_deg=0.0, spin=18.0, plunge=41.0, offset=0.0, scale=1.0, tilt=0.0, yaw=0.0, **given):
    """What needles do along a roller's typical motion, and their skews; weightless unless their mass is given."""
    values = point_values({"cycles": 4, "needle_mass_factor": 0.0, **given})
    rollers, skews = RollerMotions.for_samples(SAMPLES), np.zeros((3, int(values.cycles[0]) * SAMPLES))
    motion = (
        (rollers.spins, scale * spin * np.sin(PHI + 0.6)),
        (rollers.plunges, -scale * plunge * np.sin(2 * PHI)),
        (rollers.loads, np.full(SAMPLES, LOAD)),
        (rollers.offsets, offset * np.cos(2 * PHI)),
        (rollers.yaws, np.full(SAMPLES, yaw)),
    )
    for whole, column in motion:
        whole[:] = column.reshape(-1, WIDTH)
    row, steps = needle_constants(values)[0], NeedleSteps.for_samples(SAMPLES)
    blocks = -(-press_needles(row, rollers, steps) // WIDTH)
    needles, ring = NeedleLoads.for_blocks(blocks, steps.steps), NeedleRing.for_blocks(blocks)
    all_three = NeedleForces.of_last(2, SAMPLES)
    follow_rollers(
        row, np.full(3, np.radians(skew_deg)), tilt, steps, needles, ring, all_three, skews, np.zeros((3, 0, 0), RECORD)
    )
    assert (all_three.forces == all_three.forces[:, :1]).all()  # three trunnions with the same motion
    found = Found(*(of.mean(0)[0] for of in (all_three.forces, all_three.moments, all_three.places, all_three.skews)))
    return found, np.degrees(skews[0]), np.degrees(found.skew)


def followed(*given, **named):
    """Forces over the load, moments over it, skews in degrees and mean skew; parameters as for `moved`."""
    found, skews, mean = moved(*given, **named)
    return found.forces, found.moments, skews, mean


def test_a_free_straight_needle_slips_by_half_on_both_sides():
    """Exact: no stop within reach, so the roller feels friction against its plunging and no moment."""
    forces, moments, skews, _ = followed(needle_axial_clearance_mm=5.0, spin=0.0)
    c = NeedleConstants(*needle_constants(point_values({}))[0])
    told = 0.03 * np.tanh(0.5 * 41.0 * np.sin(2 * PHI) / c.transition)
    carried = forces[45] / told[45]
    assert 1.0 < carried < 1.1  # needles' loads in sum over the bearing load, in a zone of some 25 deg to either side
    assert forces == pytest.approx(carried * told, abs=1e-9)
    assert np.abs(moments).max() == 0.0
    assert np.abs(skews).max() == 0.0


def test_a_stopped_needle_rubs_with_its_end():
    """Exact: S = mu_n R on the pitch circle, half of it on the bore; R is the friction of the bore alone.

    Rubbing turns the needles a little, and the skew's own moment is of the same size: what it is by the skew of the most
    loaded needle is taken off, and a fiftieth is left for the others.
    """
    friction = 1e-3
    forces, moments, skews, _ = followed(needle_axial_clearance_mm=0.0, needle_sliding_friction=friction)
    c = NeedleConstants(*needle_constants(point_values({}))[0])
    spin = 18.0 * np.sin(PHI + 0.6)
    rubbing = 0.5 * friction * c.bore_radius * np.abs(forces) * np.tanh(0.5 * c.bore_radius * spin / c.transition)
    skewed = -0.5 * c.lever * np.radians(skews.reshape(-1, SAMPLES)[-2:].mean(axis=0)) * forces
    slips = np.abs(np.sin(2 * PHI)) > 0.3
    assert moments[slips] == pytest.approx((skewed - rubbing)[slips], abs=0.02 * rubbing.max())


@kernel
def _free_slips(row, total, slope, out):
    store(out, 0, _free_slip(needle_constants_of(row), spread(total), spread(slope))[0])


@pytest.mark.parametrize("slope", [-0.02, -1e-3, 0.0, 2e-3, 0.029])
@pytest.mark.parametrize("total", [-500.0, -30.0, -1.0, 0.0, 0.3, 40.0, 500.0])
def test_friction_holds_a_needle_against_a_gap_that_narrows(total, slope):
    """Exact: mu_n (tanh(v_t / v_sn) - tanh(v_b / v_sn)) is minus the slope, and both slips add up."""
    row, found = needle_constants(point_values({}))[0], np.zeros((1, WIDTH))
    c = NeedleConstants(*row)
    _free_slips(row, total, slope, found)
    on_trunnion = found[0, 0]
    assert (found == on_trunnion).all()
    held = c.sliding * (np.tanh(on_trunnion / c.transition) - np.tanh((total - on_trunnion) / c.transition))
    assert held == pytest.approx(-slope, abs=1e-9)


def test_without_stops_the_wedge_takes_large_skews_back():
    """Physics: the wedge grows with the cube of the skew, so that a fifth of the skew loses a small share of itself."""
    small, large = (followed(psi, needle_axial_clearance_mm=5.0)[2] for psi in (0.2, 1.0))
    lost = [1 - kept[-1] / kept[0] for kept in (small, large)]
    assert lost[1] > 0.5
    assert 0 < lost[0] < 0.3 * lost[1]


def test_stops_turn_needles_away_from_the_trunnion():
    """Physics: without stops a small skew falls, with a tight ring of them it grows (a column that buckles)."""
    free, stopped = (followed(0.4, needle_axial_clearance_mm=room)[3] for room in (5.0, 0.1))
    assert free < 0.4 < stopped


def test_the_law_knows_no_time_but_by_the_centrifugal_force():
    """Invariance: twice the speed with a quarter of the mass, and the quarter rule, gives the same forces and skews."""
    slow = followed(0.6, speed_rpm=600, needle_mass_factor=8.0)
    fast = followed(0.6, speed_rpm=1200, scale=2.0, needle_mass_factor=2.0)
    for one, other in zip(slow, fast, strict=True):
        assert one == pytest.approx(other, rel=1e-9, abs=1e-12)


def test_a_heavy_needle_is_thrown_against_its_outer_stop():
    """Exact force; physics: one as large as their friction keeps needles near the outer stop, without it they move about the middle."""
    c = NeedleConstants(*needle_constants(point_values({}))[0])
    assert c.thrown == pytest.approx(7.85e-9 * np.pi * 10 * 21 * (np.pi * 20) ** 2, rel=1e-9)
    free, thrown = (moved(needle_axial_clearance_mm=0.1, needle_mass_factor=mass)[0].places for mass in (0.0, 300.0))
    assert abs(free.mean()) < 0.01
    assert thrown.mean() > 0.04  # of 0.05


def test_thrown_needles_rub_on_stops_that_half_the_plunging_does_not_reach():
    """Regression: `needles` with a tolerance of 1e-3, and with needles of a tenth and of four times the mass."""
    given = {
        "relative_tolerance": 1e-6,
        "joint_angle_deg": 4.87,
        "torque_n_m": 82.69,
        "speed_rpm": 1442.19,
        "initial_skew_1_deg": 0.23,
        "initial_skew_2_deg": 0.58,
    }
    third = [
        abs(
            complex_amplitudes(
                solve_kinetostatic(point_values(given | {"needle_mass_factor": mass}), SAMPLES).groove_thrust.sum(1)
            )[0, 3]
        )
        for mass in (0.1, 1.0, 4.0)
    ]
    assert third == pytest.approx([12.728, 12.966, 13.065], rel=0.003)


def test_mirrored_skew_gives_mirrored_moments():
    """Invariance: skew and spin reversed together are the mirror image."""
    one, other = followed(0.6), followed(-0.6, spin=-18.0)
    assert one[0] == pytest.approx(other[0], rel=1e-9, abs=1e-12)
    assert one[1] == pytest.approx(-other[1], rel=1e-9, abs=1e-12)
    assert one[2] == pytest.approx(-other[2], rel=1e-9, abs=1e-12)


def test_needles_only_take_power():
    """Physics: what the sliding needles do to the roller never drives it."""
    forces, moments, _, _ = followed(1.0, needle_axial_clearance_mm=0.2)
    power = forces * -41.0 * np.sin(2 * PHI) + moments * 18.0 * np.sin(PHI + 0.6)
    assert power.max() <= 1e-12


@pytest.mark.parametrize(
    "given",
    [
        {"needle_crown_um": 10},
        {"needle_crown_um": 100},
        {"spheres_per_needle": 1},
        {"spheres_per_needle": 2, "needle_crown_um": 20},
        {"needle_count": 1},
        {"needle_count": 3},
        {"bearing_radial_clearance_mm": 0.5},
    ],
)
def test_odd_bearings_have_an_answer(given):
    """Crowned, short of spheres or needles, or loose."""
    answer = followed(1.0, offset=1.2, **given)
    assert all(np.isfinite(part).all() for part in answer)


@pytest.mark.parametrize(
    ("given", "third", "second", "phase"),
    [
        ({"initial_skew_1_deg": 0.4, "initial_skew_2_deg": -0.4, "initial_skew_3_deg": 0.4}, 14.410, 0.1757, -16.7),
        (
            {
                "joint_angle_deg": 12,
                "torque_n_m": 150,
                "speed_rpm": 900,
                "groove_sliding_friction": 0.08,
                "initial_skew_1_deg": 1,
                "initial_skew_2_deg": -0.5,
            },
            78.40,
            0.786,
            -62.5,
        ),
        (
            {
                "joint_angle_deg": 7.8686,
                "torque_n_m": 136.5223,
                "speed_rpm": 599.1667,
                "groove_sliding_friction": 0.0411,
                "needle_sliding_friction": 0.0568,
                "bearing_radial_clearance_mm": 0.0233,
                "needle_crown_um": 9.036,
                "needle_axial_clearance_mm": 0.1857,
                "initial_skew_1_deg": 0.7481,
                "initial_skew_2_deg": 0.2819,
                "initial_skew_3_deg": -0.4287,
            },
            27.163,
            3.671,
            -146.0,
        ),  # crowned: the tilt moves needles, skew grows by it
    ],
)
def test_kinetostatic_with_needles_against_needles(given, third, second, phase):
    """Regression: orders of `needles` with a tolerance of 1e-3, which are right to 0.5 and 10 %."""
    found = complex_amplitudes(
        solve_kinetostatic(point_values({"relative_tolerance": 1e-6, **given}), SAMPLES).groove_thrust.sum(1)
    )[0]
    assert abs(found[3]) == pytest.approx(third, rel=0.004)
    assert abs(found[2]) == pytest.approx(second, rel=0.12)
    assert np.degrees(np.angle(found[2])) == pytest.approx(phase, abs=6)


@kernel
def _spread(row, state, loads, offset):
    """Balance from the present lean, then take a step with the same load; whether it is known afterwards."""
    c = needle_constants_of(row)
    balance_unknown(c, state, loads[0], np.full(3, offset))
    return follow_spread(c, state, load_three(loads, 0), offset)


@pytest.mark.parametrize("lean", [-1e-1, -1e-3, 0.0, 1e-3, 1e-1])
@pytest.mark.parametrize("skew", [0.0, 0.1, 0.3, 1.0])
@pytest.mark.parametrize("load", [1e-3, 1.0, 300.0])
def test_a_load_spreads_along_its_needle_whatever_its_spread_was(load, skew, lean):
    """Exact: forces of the spheres are in balance with the load at its place, to the tolerance of the balance."""
    values = point_values({"needle_crown_um": 8.0})
    row, state = needle_constants(values)[0], np.zeros((ROWS, 3 * WIDTH))
    c = NeedleConstants(*row)
    state[SKEW], state[PLACE], offset = skew, 0.1, 0.3 * c.length
    state[[TRUNNION + LEAN, BORE + LEAN]], state[[TRUNNION + VARIANCE, BORE + VARIANCE]] = lean, UNKNOWN
    assert _spread(row, state, np.full((1, 3 * WIDTH), load), offset)
    at = c.length * ((np.arange(c.spheres) + 0.5) / c.spheres - 0.5)
    for first, sign in ((TRUNNION, 1), (BORE, -1)):
        drop = c.drop + sign * 0.5 * skew**2 / c.pitch_radius
        depth, leans, variance = (state[first + field, 0] for field in (DEPTH, LEAN, VARIANCE))
        force = c.stiffness / c.spheres * np.maximum(depth + (leans - drop * at) * at, 0.0) ** (10 / 9)
        assert force.sum() == pytest.approx(load, rel=2e-3)
        assert force @ at == pytest.approx(load * (offset - 0.1), abs=2e-3 * load * c.length)
        assert variance == pytest.approx(force @ at**2 / load - (offset - 0.1) ** 2, abs=0.02 * c.length**2)


def test_needles_that_touch_with_their_ends_are_held_by_both():
    """Exact (lever rule): a strongly skewed needle touches the bore with its two ends, which share its load by place."""
    row, state = needle_constants(point_values({}))[0], np.zeros((ROWS, 3 * WIDTH))
    c = NeedleConstants(*row)
    end, place = c.length * (0.5 - 0.5 / c.spheres), 0.1 * c.length
    state[SKEW], state[[TRUNNION + VARIANCE, BORE + VARIANCE]], state[BORE + LEAN] = 0.5, UNKNOWN, 0.05  # one end
    assert _spread(row, state, np.full((1, 3 * WIDTH), 100.0), place)
    assert state[BORE + VARIANCE] == pytest.approx(end**2 - place**2, rel=0.01)


def test_no_answer_hangs_on_rounding():
    """Invariance: at this joint, whose needles turn far, a relative change of the torque by 3e-15 moved the third order
    by 0.3 %, since the loads along them jumped from end to end."""
    given = {
        "joint_angle_deg": 15.4096,
        "speed_rpm": 983.331,
        "groove_sliding_friction": 0.149406,
        "needle_sliding_friction": 0.0231752,
        "groove_rolling_friction": 0.00390328,
        "needle_rolling_friction": 0.00126836,
        "transition_ratio": 0.394244,
        "initial_skew_1_deg": -1.41093,
        "initial_skew_2_deg": -1.30676,
        "initial_skew_3_deg": -0.569183,
        "bearing_radial_clearance_mm": 0.0433759,
        "needle_axial_clearance_mm": 0.239277,
        "needle_crown_um": 4.68785,
        "pitch_radius_mm": 16.7751,
        "roller_radius_mm": 18.0011,
        "needle_count": 22,
        "needle_diameter_mm": 1.74259,
        "needle_length_mm": 8.42482,
        "needle_pitch_diameter_mm": 16.9993,
        "groove_spinning": 0,
        "groove_rolling": 0,
        "relative_tolerance": 1e-6,
    }
    torques = [-13.7447 * (1 + k * 3e-15) for k in range(4)]
    thirds = [
        abs(
            complex_amplitudes(
                solve_kinetostatic(point_values({**given, "torque_n_m": torque}), SAMPLES).groove_thrust.sum(1)
            )[0, 3]
        )
        for torque in torques
    ]
    assert np.ptp(thirds) < 5e-4 * thirds[0]
