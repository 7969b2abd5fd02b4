"""The needle bearing as one element: load zone, friction, balance of power, derivatives, and runs against closed forms."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from tripod_doe.errors import InputError
from tripod_doe.mechanics.arithmetic.rotations import move
from tripod_doe.mechanics.assembly import State, assemble
from tripod_doe.mechanics.forces.bearing import bearing_compression
from tripod_doe.mechanics.run import Limits, run
from tripod_doe.mechanics.scene import GROUND, Body, Cylinder, Friction, NeedleBearing, Scene, SphereRow, Spring
from tripod_doe.mechanics.solve.equations_of_motion import generalized_forces, linearise
from tripod_doe.model_interface import Outcome

TRUNNION, DIAMETER, LENGTH, NEEDLES, SLICES = 7.64, 2.0, 10.0, 27, 7
STIFFNESS = 8.15e4 * LENGTH ** (8 / 9) / SLICES
FRICTION = Friction(0.03, 2.0, 0.002, rolling_transition=10.0)
CLEARANCES = [0.015, 0.0, -0.004, -0.03]
Z = (0.0, 0.0, 1.0)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(300)


def bearing(clearance, trunnion="trunnion", **values):
    inner = Cylinder(trunnion, TRUNNION, axis=Z)
    bore = Cylinder("roller", TRUNNION + DIAMETER + clearance, axis=Z, concave=True)
    return NeedleBearing(inner, bore, DIAMETER, LENGTH, NEEDLES, STIFFNESS, **values)


def forces(assembly, state):
    work = assembly.work()
    generalized_forces(assembly.tables, work, state.positions, state.velocities)
    return work


def on_ground(clearance, offset, velocity=(0.0,) * 6, **values):
    """Force on a roller that is held off a fixed trunnion, and the ledger."""
    roller = Body("roller", 1.0, (1.0,) * 3, position=offset, velocity=velocity[:3], angular_velocity=velocity[3:])
    assembly = assemble(Scene((roller,), bearings=(bearing(clearance, GROUND, **values),)))
    work = forces(assembly, assembly.initial_state())
    return work.force[1], work.ledger


def zone_moment(shift, clearance, power):
    """Needle loads times cos^power, summed over the circumference: a rule that the element knows nothing of."""
    edge = math.acos(min(max(clearance / shift, -1.0), 1.0))
    cosine = np.cos(0.5 * edge * (1 + NODES))
    load = SLICES * STIFFNESS * (0.5 * np.maximum(shift * cosine - clearance, 0.0)) ** (10 / 9)
    return NEEDLES / math.pi * 0.5 * edge * float(WEIGHTS @ (load * cosine**power))


def derivatives(assembly, state, secant=0.0):
    """Block matrices -dQ/dv and -dQ/dq."""
    matrices = []
    for factors in ((1.0, 0.0), (0.0, 1.0)):
        work = assembly.work()
        linearise(assembly.tables, work, state.positions, state.velocities, secant, *factors, work.matrix)
        matrices.append(work.matrix[:, :, :6])
    return matrices


def pair(clearance, seed, damping=(1e-3, 1e-5), tilting=1.0, **values):
    """Trunnion and roller anywhere in space, near each other, with any motion; both inertias are spheres'."""
    rng = np.random.default_rng(seed)
    trunnion = Body(
        "trunnion",
        1.0,
        (1.0,) * 3,
        position=(3.0, -2.0, 1.0),
        attitude=tuple(rng.normal(size=4)),
        velocity=tuple(rng.normal(size=3)),
        angular_velocity=tuple(rng.normal(size=3)),
    )
    roller = Body("roller", 1.0, (1.0,) * 3, velocity=tuple(rng.normal(size=3)))
    element = bearing(clearance, skew=0.1, damping=damping[0], damping_time=damping[1], friction=FRICTION, **values)
    inner = dataclasses.replace(element.trunnion, point=(0.5, 1.0, -2.0))
    assembly = assemble(Scene((trunnion, roller), bearings=(dataclasses.replace(element, trunnion=inner),)))
    state = assembly.initial_state()
    state.positions[2] = state.positions[1]
    # the bore's axis a little off the trunnion's and a little inclined, the roller turned and pushed along it
    place = _turn(state.positions[1, 3:]) @ np.array([0.515, 1.009, -1.7])
    step = np.concatenate([place, 3e-4 * rng.normal(size=3) + 0.7 * _turn(state.positions[1, 3:])[:, 2]])
    move(state.positions[2], step, state.positions[2])
    state.velocities[2, 3:] = state.velocities[1, 3:] + tilting * rng.normal(size=3)
    state.velocities[2, 3:] += 5.0 * _turn(state.positions[1, 3:])[:, 2]
    return assembly, state


def _turn(q):
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.mark.parametrize("clearance", CLEARANCES)
def test_load_zone_is_the_integral_over_the_needles(clearance):
    """Exact physics: force and stored energy against quadrature, one body held at its place."""
    shift = max(clearance, 0.0) + 0.006
    force, ledger = on_ground(clearance, (-shift, 0.0, 0.0))
    # of the rule for narrow zones, of its widest one, and of the rule beyond a right angle
    accuracy = 1e-9 if clearance > 0 else 2e-7 if clearance == 0 else 3e-5
    assert force[0] == pytest.approx(zone_moment(shift, clearance, 1), rel=accuracy)
    np.testing.assert_allclose(force[1:], 0, atol=1e-9 * force[0])
    energy = quad(lambda x: zone_moment(x, clearance, 1), max(clearance, 1e-9), shift, epsrel=1e-8)[0]
    rest = on_ground(clearance, (0.0, 0.0, 0.0))[1][0]
    assert ledger[0] - rest == pytest.approx(energy, rel=30 * accuracy)


def test_most_loaded_needle_without_clearance():
    """Published number: 4.08 F/Z of the needle bearing handbooks (4.085 for m = 10/9)."""
    force = on_ground(0.0, (0.0, -5e-3, 0.0))[0]
    most = SLICES * STIFFNESS * (0.5 * 5e-3) ** (10 / 9)
    assert NEEDLES * most / force[1] == pytest.approx(4.085, abs=0.001)


def test_nothing_touches_within_the_clearance():
    force, ledger = on_ground(0.015, (0.0149, 0.0, 0.0), velocity=(1.0, 2.0, 3.0, 0.1, 0.2, 30.0), friction=FRICTION)
    assert not force.any()
    assert not ledger[[0, 2, 3, 4, 5]].any()


@pytest.mark.parametrize("clearance", CLEARANCES)
@pytest.mark.parametrize("seed", range(4))
def test_action_is_reaction_and_power_balances(clearance, seed):
    """Exact physics, random states: no force or moment in sum, and power = -(rate of stored energy) - losses."""
    assembly, state = pair(clearance, seed)
    work = forces(assembly, state)
    force, places = work.force, state.positions[:, :3]
    size = np.abs(force).max()
    assert size > 100.0
    np.testing.assert_allclose(force[1:, :3].sum(axis=0), 0, atol=1e-12 * size)
    moments = force[1:, 3:] + np.cross(places[1:], force[1:, :3])
    np.testing.assert_allclose(moments.sum(axis=0), 0, atol=1e-11 * size)
    energy = []
    for sign in (1.0, -1.0):
        other = state.copy()
        for i in (1, 2):
            move(other.positions[i], sign * 1e-8 * state.velocities[i], other.positions[i])
        energy.append(forces(assembly, other).ledger[0])
    power = (force * state.velocities).sum()
    stored, lost = (energy[0] - energy[1]) / 2e-8, work.ledger[2:].sum()
    assert (work.ledger[[2, 4, 5]] > 0).all()
    scale = np.abs(force[2, :3]).max() * np.abs(state.velocities).max()
    # central differences; 1e-5 where the rule begins beyond a right angle
    assert power == pytest.approx(-stored - lost, abs=(1e-7 if clearance >= 0 else 1e-5) * scale)


@pytest.mark.parametrize("clearance", CLEARANCES)
@pytest.mark.parametrize("crown", [0.0, 0.003])
def test_derivatives_are_those_of_the_forces(clearance, crown):
    """Exact physics: -dQ/dv, and -dQ/dq of the roller, by central differences.

    Left out: what turns with the roller's lean is of the forces' size, not of stiffness times length; and how its
    tilting changes the slip around the trunnion, which is slow here as it is in a joint.
    """
    assembly, state = pair(clearance, 1, damping=(0.0, 0.0), tilting=0.02, crown=crown)
    pattern = assembly.tables.pattern
    dissipation, stiffness = derivatives(assembly, state)
    for matrix, size, accuracy in ((dissipation, 1e-5, 1e-5), (stiffness, 1e-8, 2.5e-3)):
        for body, column in ((b, c) for b in (1, 2) for c in range(6)):
            if matrix is stiffness and body == 1:
                continue  # all forces turn with the trunnion: of their size, not of stiffness times length
            change = np.zeros((3, 6))
            change[body, column] = size
            sides = []
            for sign in (1.0, -1.0):
                other = state.copy()
                if matrix is dissipation:
                    other.velocities += sign * change
                else:
                    move(other.positions[body], sign * change[body], other.positions[body])
                sides.append(forces(assembly, other).force)
            slope = (sides[0] - sides[1]) / (2 * size)
            for block, row, other_row in zip(matrix, pattern.row, pattern.column, strict=True):
                if other_row == body - 1:
                    np.testing.assert_allclose(-slope[row + 1], block[:, column], atol=accuracy * np.abs(matrix).max())


@pytest.mark.parametrize("damping", [(1e-3, 0.0), (0.0, 1e-5)])
def test_damping_is_in_the_matrix(damping):
    """Exact physics: -dQ/dv of either damping without friction, but for the bore's lean of 3e-4."""
    assembly, state = pair(0.015, 2, damping)
    assembly.tables.bearings["sliding"] = assembly.tables.bearings["rolling"] = 0.0
    block = derivatives(assembly, state)[0][assembly.tables.bearings["pair"][0, 3]]
    for column in range(6):
        ahead, behind = state.copy(), state.copy()
        ahead.velocities[2, column] += 1e-3
        behind.velocities[2, column] -= 1e-3
        slope = (forces(assembly, ahead).force[2] - forces(assembly, behind).force[2]) / 2e-3
        np.testing.assert_allclose(-slope, block[:, column], atol=5e-4 * np.abs(block).max())


@pytest.mark.parametrize("clearance", CLEARANCES)
def test_greased_needles_damp_by_a_time_over_their_stiffness(clearance):
    """Exact physics: with damping tau dF/dx the force ahead of a motion by tau is the force with that velocity."""
    time, velocity = 1e-5, (2.0, 3.0, 0.0)
    place = np.array([-max(clearance, 0.0) - 0.006, 0.0, 0.0])
    moving = on_ground(clearance, tuple(place), (*velocity, 0.0, 0.0, 0.0), damping_time=time)[0]
    step = time * np.array(velocity)
    force, ahead, behind = (on_ground(clearance, tuple(place + side * step))[0] for side in (0, 1, -1))
    np.testing.assert_allclose(moving[:3] - force[:3], (ahead - behind)[:3] / 2, atol=1e-5 * np.abs(force).max())
    assert np.abs(moving[:2] - force[:2]).min() > 1e-3 * np.abs(force).max()


def test_friction_falls_with_its_secant():
    """Exact physics: with the secant slope the matrix times the velocity is the friction itself."""
    velocity = (0.0, 0.0, 7.0, 0.0, 0.0, 0.0)
    roller = Body("roller", 1.0, (1.0,) * 3, position=(0.02, 0.0, 0.0), velocity=velocity[:3])
    assembly = assemble(Scene((roller,), bearings=(bearing(0.015, GROUND, skew=0.1, friction=FRICTION),)))
    state = assembly.initial_state()
    work = forces(assembly, state)
    block = derivatives(assembly, state, 1.0)[0][assembly.tables.bearings["pair"][0, 3]]
    np.testing.assert_allclose((block @ velocity)[[2, 5]], -work.force[1, [2, 5]], rtol=1e-12)


@pytest.mark.parametrize("spin", [300.0, -300.0])
def test_rolling_resistance_acts_at_the_pitch_radius(spin):
    """Exact physics: mu_r f d/2 at both contacts of every needle adds up to mu_r (sum f) r_p."""
    friction = Friction(rolling=0.002, rolling_transition=1.0)
    force, ledger = on_ground(0.015, (0.02, 0.0, 0.0), (0, 0, 0, 0, 0, spin), friction=friction)
    pitch = TRUNNION + 0.5 * (DIAMETER + 0.015)
    torque = 0.002 * zone_moment(0.02, 0.015, 0) * pitch
    assert force[5] == pytest.approx(-math.copysign(torque, spin), rel=1e-8)
    assert ledger[4] == pytest.approx(torque * abs(spin), rel=1e-8)
    assert ledger[2] == 0.0
    slow = on_ground(0.015, (0.02, 0.0, 0.0), (0, 0, 0, 0, 0, 1.0), friction=friction)[0]
    assert slow[5] == pytest.approx(-torque * math.tanh(1.0), rel=1e-8)


@pytest.mark.parametrize("skew", [0.01, -0.2])
@pytest.mark.parametrize("along", [50.0, -50.0])
def test_skewed_needles_turn_a_roller_that_slides(skew, along):
    """Exact physics with the contract's sign: skew is positive counterclockwise about the outward normal.

    On the side of +x the outward normal is x, and counterclockwise about it a needle leans from z towards -y. A roller
    sliding along +z drags such needles along; they roll away under it, so it is turned towards -y there.
    """
    friction = Friction(sliding=0.03, sliding_transition=0.5)
    force, _ = on_ground(0.015, (-0.02, 0.0, 0.0), (0, 0, along, 0, 0, 0), skew=skew, friction=friction)
    bore, load = TRUNNION + DIAMETER + 0.015, zone_moment(0.02, 0.015, 0)
    drag = 0.03 * load * math.copysign(1.0, along)
    lever = bore * TRUNNION / (TRUNNION + 0.5 * (DIAMETER + 0.015))
    assert force[2] == pytest.approx(-drag * math.cos(skew), rel=1e-8)
    assert force[5] == pytest.approx(drag * lever * math.sin(skew), rel=1e-8)


@pytest.mark.parametrize(("skew", "spin"), [(0.05, 0.0), (0.05, 30.0), (-0.2, 0.0)])
def test_a_needle_that_is_a_body_drags_and_turns_the_bore_alike(skew, spin):
    """Exact physics: one preloaded needle with six degrees of freedom finds sign and lever r_b r_t / r_p by itself."""
    gap, along = -0.003, 20.0
    bore = TRUNNION + DIAMETER + gap
    pitch = 0.5 * (TRUNNION + bore)
    axis = np.array([0.0, -math.sin(skew), math.cos(skew)])  # counterclockwise from z about x, the outward normal
    mass = 7.85e-9 * math.pi
    needle = Body(
        "needle",
        mass,
        (mass / 2, mass / 3, mass / 3),
        position=(pitch, 0, 0),
        velocity=(0, spin * bore / 2, along / 2),
        attitude=(1.0 + axis[0], *np.cross([1.0, 0.0, 0.0], axis)),
    )
    ring = Body("bore", 1.0, (1.0,) * 3, velocity=(0, 0, along), angular_velocity=(0, 0, spin), locked=(True,) * 6)
    raceways = (Cylinder(GROUND, TRUNNION, axis=Z), Cylinder("bore", bore, axis=Z, concave=True))
    rows = tuple(
        SphereRow("needle", raceway, 1.0, STIFFNESS, 10 / 9, count=3, length=1.0, friction=Friction(0.03, 0.2))
        for raceway in raceways
    )
    assembly = assemble(Scene((needle, ring), contacts=rows, speed_scale=100.0, rotation_scale=100.0))
    result = run(assembly, "bdf2", 5e-4, step=2e-6, limits=Limits(windows=0, energy=math.inf))
    assert result.outcome == Outcome.FINISHED, result.detail
    force = forces(assembly, State(result.times[-1], result.positions[-1], result.velocities[-1])).force[2]
    assert force[2] < -1.0
    assert force[5] / force[2] == pytest.approx(-bore * TRUNNION / pitch * math.tan(skew), rel=3e-4)
    roller = on_ground(gap, (-0.001, 0.0, 0.0), (0, 0, along, 0, 0, spin), skew=skew, friction=Friction(0.03, 0.2))[0]
    assert roller[5] / roller[2] == pytest.approx(force[5] / force[2], rel=3e-4)


def test_saturation_follows_the_quarter_rule_at_either_contact():
    """Exact physics: the transition velocity is that of one contact, half of the slip between bore and trunnion."""
    drag = [on_ground(0.0, (-0.01, 0, 0), (0, 0, w, 0, 0, 0), friction=FRICTION)[0][2] for w in (4.0, 400.0)]
    assert drag[0] / drag[1] == pytest.approx(math.tanh(1.0), rel=1e-12)


def test_axial_friction_tilts_at_the_pitch_radius_of_the_loaded_side():
    """Exact physics: the loaded needles hold the roller back on their side."""
    force, _ = on_ground(0.015, (-0.02, 0.0, 0.0), (0, 0, 50.0, 0, 0, 0), friction=FRICTION)
    pitch = TRUNNION + 0.5 * (DIAMETER + 0.015)
    along, total = zone_moment(0.02, 0.015, 1), zone_moment(0.02, 0.015, 0)
    # about the roller's centre, which is off by 0.02; x cross -z is +y
    assert force[4] == pytest.approx(0.03 * (along * pitch + 0.02 * total), rel=1e-8)


def test_tilt_is_resisted_by_the_slices():
    """Exact physics: moment of a tilted roller against the sum over slices, each with its own load zone."""
    tilt, crown = 1e-3, 0.002
    roller = Body("roller", 1.0, (1.0,) * 3, position=(0.02, 0, 0), attitude=(1.0, 0.0, tilt / 2, 0.0))
    assembly = assemble(Scene((roller,), bearings=(bearing(0.015, GROUND, crown=crown),)))
    force = forces(assembly, assembly.initial_state()).force[1]
    share = (np.arange(SLICES) + 0.5) / SLICES - 0.5
    shifts, gaps = 0.02 + math.tan(tilt) * LENGTH * share, 0.015 + 2 * crown * (2 * share) ** 2
    loads = [zone_moment(s, c, 1) / SLICES if s > c else 0.0 for s, c in zip(shifts, gaps, strict=True)]
    assert force[0] == pytest.approx(-sum(loads), rel=1e-5)
    assert force[4] == pytest.approx(-np.dot(loads, LENGTH * share), rel=1e-3)  # the axial part acts at the offset


@pytest.mark.parametrize("clearance", CLEARANCES)
def test_result_turns_with_the_scene(clearance):
    """Invariance: the whole scene in another attitude, and the trunnion turned about its own axis."""
    assembly, state = pair(clearance, 3)
    first = forces(assembly, state)
    turned = state.copy()
    for i in (1, 2):
        move(turned.positions[i], np.array([0, 0, 0, 0.3, -0.8, 1.1]), turned.positions[i])
    turn = _turn(turned.positions[1, 3:]) @ _turn(state.positions[1, 3:]).T
    for values, start in ((turned.positions, 0), (turned.velocities, 0), (turned.velocities, 3)):
        values[1:, start : start + 3] = values[1:, start : start + 3] @ turn.T
    second = forces(assembly, turned)
    rotated = np.hstack([first.force[:, :3] @ turn.T, first.force[:, 3:] @ turn.T])
    np.testing.assert_allclose(second.force, rotated, atol=1e-9 * np.abs(rotated).max())
    np.testing.assert_allclose(second.ledger[2:], first.ledger[2:], rtol=1e-9)


def test_load_zone_has_no_ripple():
    """Invariance: the force depends on how far the roller is off, not in which direction."""
    sizes = []
    for angle in np.linspace(0, 2 * math.pi / NEEDLES, 7):
        force = on_ground(0.015, (0.02 * math.cos(angle), 0.02 * math.sin(angle), 0.0))[0]
        sizes.append(math.hypot(force[0], force[1]))
        assert math.atan2(-force[1], -force[0]) == pytest.approx(angle, abs=1e-12)
    assert np.ptp(sizes) < 1e-12 * sizes[0]


def _spinning(load, spin, friction, inertia=400.0, skew=0.0, locked=(False,) * 6, velocity=(0.0,) * 3):
    """A roller on a fixed trunnion, pressed by a load along x, at its place of balance; mass in t, N, mm, s."""
    shift = brentq(lambda x: zone_moment(x, 0.015, 1) - load, 0.0151, 0.03, xtol=1e-15)
    roller = Body(
        "roller",
        4e-5,
        (inertia, inertia, inertia),
        position=(shift, 0, 0),
        force=(load, 0, 0),
        velocity=velocity,
        angular_velocity=(0, 0, spin),
        locked=locked,
    )
    element = bearing(0.015, GROUND, friction=friction, damping=1e-3, skew=skew)
    scene = Scene((roller,), bearings=(element,), length_scale=1.0, speed_scale=100.0, rotation_scale=10.0)
    return assemble(scene), shift


@pytest.mark.parametrize("method", ["bdf2", "implicit-euler"])
def test_loaded_roller_runs_down(method):
    """Exact physics: a spinning roller loses mu_r (sum f) r_p / I of its spin per second, and the energy balances."""
    inertia, spin = 6e-3, 20.0
    assembly, shift = _spinning(800.0, spin, Friction(rolling=0.002, rolling_transition=1e-2), inertia)
    brake = 0.002 * zone_moment(shift, 0.015, 0) * (TRUNNION + 0.5 * (DIAMETER + 0.015))
    duration = 0.5 * spin * inertia / brake
    result = run(assembly, method, duration, step=duration / 500, samples=4)
    assert result.outcome == Outcome.FINISHED, result.detail
    assert result.velocities[-1, 1, 5] == pytest.approx(0.5 * spin, rel=1e-4)
    assert result.energy_residual < 1e-4
    assert result.work[3] == pytest.approx(0.5 * inertia * spin**2 * 0.75, rel=1e-3)


def test_screw_of_skewed_needles():
    """Exact physics: pushed along its trunnion, a roller turns until its skewed needles roll without slip.

    s = w / (r_e tan psi), the speed of the screw with the lever r_b r_t / r_p; the energy put in is lost or stored.
    """
    skew, along = 0.3, 20.0
    locked = (False, False, True, True, True, False)
    assembly, _ = _spinning(800.0, 0.0, Friction(0.05, 5.0), 6e-3, skew=skew, locked=locked, velocity=(0.0, 0.0, along))
    result = run(assembly, "bdf2", 0.02, step=1e-5, samples=4)
    assert result.outcome == Outcome.FINISHED, result.detail
    bore, pitch = TRUNNION + DIAMETER + 0.015, TRUNNION + 0.5 * (DIAMETER + 0.015)
    assert result.velocities[-1, 1, 5] == pytest.approx(along * pitch / (bore * TRUNNION * math.tan(skew)), rel=1e-3)
    assert result.energy_residual < 1e-3


def test_energy_balances_while_a_roller_plunges():
    """Exact physics: all mechanisms at once, skewed needles, and a tilting roller on an axial spring."""
    shift = brentq(lambda x: zone_moment(x, 0.015, 1) - 800.0, 0.0151, 0.03, xtol=1e-15)
    roller = Body(
        "roller", 5e-5, (4e-3, 4e-3, 6e-3), position=(shift, 0, 0.4), force=(800.0, 0, 0), angular_velocity=(0, 0, 20.0)
    )
    spring = Spring(GROUND, "roller", 200.0, 100.0, point_a=(0, 0, -100.0))
    element = bearing(
        0.015, GROUND, friction=Friction(0.03, 5.0, 0.002, rolling_transition=15.0), skew=0.01, damping=1e-3
    )
    scene = Scene((roller,), bearings=(element,), springs=(spring,), speed_scale=100.0, rotation_scale=10.0)
    result = run(assemble(scene), "rosenbrock", 4e-3, samples=4, limits=Limits(windows=0))
    assert result.outcome == Outcome.FINISHED, result.detail
    assert result.energy_residual < 1e-4
    assert result.work[1] > 1.0
    assert result.work[3] > 0.1
    assert np.abs(result.positions[:, 1, 4]).max() > 1e-6  # friction on the loaded side tilts it


def test_compression_is_noticed():
    """Exact physics: half of what the slice in the middle of the load is pressed by, over the needle's radius."""
    assembly, shift = _spinning(800.0, 0.0, FRICTION)
    state = assembly.initial_state()
    deepest, share, depth, body, _ = bearing_compression(
        assembly.tables.bearings, state.positions[None], state.velocities[None]
    )
    assert deepest == depth == pytest.approx(0.5 * (shift - 0.015), rel=1e-9)
    assert share == pytest.approx(depth / 1.0)
    assert body == 1


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"trunnion": Cylinder("roller", 7.0, axis=Z)}, "two bodies"),
        ({"trunnion": Cylinder("spindle", 7.0, axis=Z)}, "spindle"),
        ({"bore": Cylinder("roller", 9.0, axis=Z)}, "concave"),
        ({"bore": Cylinder("roller", 7.0, axis=Z, concave=True)}, "wider"),
        ({"count": 0}, "count"),
        ({"damping": -1.0}, "damping"),
        ({"damping_time": -1e-6}, "damping"),
        ({"skew": 2.0}, "right angle"),
        ({"friction": Friction(sliding_transition=0.0)}, "transition"),
        ({"friction": Friction(spinning=0.1)}, "spin"),
    ],
)
def test_bearings_that_cannot_be_are_refused(change, reason):
    roller = Body("roller", 1.0, (1.0,) * 3)
    with pytest.raises(InputError, match=reason):
        assemble(Scene((roller,), bearings=(dataclasses.replace(bearing(0.015, GROUND), **change),)))
