"""Contact elements: closed forms, action and reaction, and derivatives against differences (exact physics)."""

import numpy as np
import pytest

from tripod_doe.mechanics.arithmetic.rotations import move
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.scene import GROUND, Body, Cylinder, Friction, Plane, Scene, SphereRow
from tripod_doe.mechanics.solve.equations_of_motion import generalized_forces, linearise

FRICTION = Friction(0.05, 2.0, 0.002, 1.0, 0.5, 0.004, 0.3)
SURFACES = {
    "sphere on plane": (Plane("base"), 1, (0.0, 0.0, 0.998)),
    "sphere in groove": (Cylinder("base", 1.1, concave=True), 1, (0.3, 0.06, -0.09)),
    "row on convex cylinder": (Cylinder("base", 4.0), 7, (0.2, 3.0, 3.996)),
    "row in concave cylinder": (Cylinder("base", 6.0, concave=True), 7, (0.2, -3.0, -4.003)),
}


def _forces(assembly, state):
    work = assembly.work()
    generalized_forces(assembly.tables, work, state.positions, state.velocities)
    return work


def _pair(surface, count, position, friction=FRICTION):
    body = Body(
        "needle",
        1e-3,
        (1.0, 1.0, 1.0),
        position=position,
        velocity=(1.0, -0.5, 0.1),
        angular_velocity=(0.3, 0.2, 0.4),
        attitude=(1.0, 0.0, 0.001, 0.0),
    )
    base = Body("base", 1.0, (1.0, 1.0, 1.0), angular_velocity=(0.1, -0.2, 0.05), velocity=(0.1, 0.2, 0.0))
    row = SphereRow(
        "needle",
        surface,
        1.0,
        1e5,
        exponent=10 / 9,
        count=count,
        length=3.0,
        damping=0.01,
        damping_time=5e-4,
        friction=friction,
    )
    return assemble(Scene((body, base), contacts=(row,)))


@pytest.mark.parametrize("name", SURFACES)
def test_action_is_reaction(name):
    assembly = _pair(*SURFACES[name])
    state = assembly.initial_state()
    work = _forces(assembly, state)
    force, places = work.force, state.positions[:, :3]
    inertia_terms = np.zeros_like(force)  # both inertias are spheres': no gyroscopic moment
    assert np.abs(force).max() > 1.0
    total = force[1:] - inertia_terms[1:]
    np.testing.assert_allclose(total[:, :3].sum(axis=0), 0, atol=1e-12 * np.abs(force).max())
    moments = total[:, 3:] + np.cross(places[1:], total[:, :3])
    np.testing.assert_allclose(moments.sum(axis=0), 0, atol=1e-11 * np.abs(force).max())


def test_sphere_on_plane_follows_every_law():
    depth, radius = 0.002, 1.0
    velocity, spin = (3.0, 4.0, 0.0), 0.6
    body = Body(
        "ball", 1.0, (1.0,) * 3, position=(0, 0, radius - depth), velocity=velocity, angular_velocity=(0, 0, spin)
    )
    row = SphereRow("ball", Plane(GROUND), radius, 1e5, exponent=1.5, friction=FRICTION)
    assembly = assemble(Scene((body,), contacts=(row,)))
    work = _forces(assembly, assembly.initial_state())
    load = 1e5 * depth**1.5  # Eq. 2
    slide = 0.05 * load * np.tanh(5.0 / 2.0) * np.array([0.6, 0.8])  # Eq. 3
    np.testing.assert_allclose(work.force[1, :3], [*-slide, load], rtol=1e-12)
    np.testing.assert_allclose(work.force[1, 3:5], np.cross([0, 0, -radius], [*-slide, 0])[:2], rtol=1e-12)
    moment = 0.004 * load ** (4 / 3) * np.tanh(0.6 / 0.3)  # Eq. 7
    assert work.force[1, 5] == pytest.approx(-moment, rel=1e-12)
    assert work.ledger[2] == pytest.approx(np.linalg.norm(slide) * 5.0, rel=1e-12)
    assert work.ledger[3] == pytest.approx(moment * 0.6, rel=1e-12)


def test_rolling_resistance_opposes_rolling_alone():
    body = Body("ball", 1.0, (1.0,) * 3, position=(0, 0, 0.998), velocity=(0.7, 0, 0), angular_velocity=(0, 0.7, 0))
    row = SphereRow("ball", Plane(GROUND), 1.0, 1e5, friction=Friction(0.05, 2.0, 0.002, 1.0, 0.5))
    assembly = assemble(Scene((body,), contacts=(row,)))
    work = _forces(assembly, assembly.initial_state())
    load = 1e5 * 0.002**1.5
    np.testing.assert_allclose(work.force[1, :2], 0, atol=1e-12)
    assert work.force[1, 4] == pytest.approx(-0.002 * load * 1.0 * np.tanh(0.7 / 0.5), rel=1e-12)  # Eq. 4


def test_a_crowned_row_carries_in_its_middle_first():
    def load(crown):
        row = SphereRow("needle", Plane(GROUND), 1.0, 1e5, exponent=10 / 9, count=7, length=10.0, crown=crown)
        body = Body("needle", 1.0, (1.0,) * 3, position=(0, 0, 1 - 1e-3))
        assembly = assemble(Scene((body,), contacts=(row,)))
        return _forces(assembly, assembly.initial_state()).force[1, 2]

    place = (np.arange(7) + 0.5) / 7 - 0.5
    depths = np.maximum(1e-3 - 0.005 * (2 * place) ** 2, 0)
    assert load(0.005) == pytest.approx((1e5 * depths ** (10 / 9)).sum(), rel=1e-12)
    assert load(0.0) == pytest.approx(7 * 1e5 * 1e-3 ** (10 / 9), rel=1e-12)


@pytest.mark.parametrize("name", SURFACES)
def test_derivatives_are_those_of_the_forces(name):
    """-dQ/dv exactly; -dQ/dq for translations, where no term is left out, on a base that does not turn."""
    assembly = _pair(*SURFACES[name])
    tables, pattern, state = assembly.tables, assembly.tables.pattern, assembly.initial_state()
    work = assembly.work()
    linearise(tables, work, state.positions, state.velocities, 0.0, 1.0, 0.0, work.dissipation)
    linearise(tables, work, state.positions, state.velocities, 0.0, 0.0, 1.0, work.stiffness)
    scale = np.abs(work.dissipation).max()
    for column in range(6):
        change = np.zeros((3, 6))
        change[1, column] = 1e-6
        ahead, behind = state.copy(), state.copy()
        ahead.velocities += change
        behind.velocities -= change
        slope = (_forces(assembly, ahead).force - _forces(assembly, behind).force) / 2e-6
        for block, row, other in zip(work.dissipation, pattern.row, pattern.column, strict=True):
            if other == 0:  # central differences: 1e-6 of the largest entry
                np.testing.assert_allclose(-slope[row + 1], block[:, column], atol=2e-6 * scale)
    block = work.stiffness[tables.contacts["pair"][0, 0]]
    for column in range(3):
        change = np.zeros((3, 6))
        change[1, column] = 1e-8
        ahead, behind = state.copy(), state.copy()
        move(ahead.positions[1], change[1], ahead.positions[1])
        move(behind.positions[1], -change[1], behind.positions[1])
        slope = (_forces(assembly, ahead).force - _forces(assembly, behind).force) / 2e-8
        # left out: the turn of friction with the normal, of the size of friction against stiffness times length
        np.testing.assert_allclose(-slope[1, :3], block[:3, column], atol=3e-3 * np.abs(block[:3, :3]).max())


def test_a_sphere_that_moves_around_its_groove_turns_the_normal_force_about_its_centre():
    """Exact physics: no moment but that of friction, whose slip changes as the tangents turn."""
    assembly = _pair(*SURFACES["sphere in groove"], friction=Friction(0.05, 2.0))
    tables, state, work = assembly.tables, assembly.initial_state(), assembly.work()
    state.velocities[2, 3:] = 0.0  # else its surface moves differently from place to place
    linearise(tables, work, state.positions, state.velocities, 0.0, 0.0, 1.0, work.stiffness)
    block = work.stiffness[tables.contacts["pair"][0, 0]]
    for column in range(3):
        moments = []
        for sign in (1.0, -1.0):
            other = state.copy()
            move(other.positions[1], sign * 1e-8 * np.eye(6)[column], other.positions[1])
            moments.append(_forces(assembly, other).force[1, 3:])
        slope = (moments[0] - moments[1]) / 2e-8
        # left out: the penetration's rate, which turns with the normal
        np.testing.assert_allclose(-slope, block[3:, column], atol=0.01 * np.abs(block[3:, :3]).max())


@pytest.mark.parametrize("name", SURFACES)
def test_one_pass_gives_forces_and_their_derivatives(name):
    """The sum of both derivatives is what is asked for, and the forces stay the same."""
    assembly = _pair(*SURFACES[name])
    tables, state = assembly.tables, assembly.initial_state()
    alone, work = _forces(assembly, state), assembly.work()
    moving = (tables, work, state.positions, state.velocities, 0.7)
    linearise(*moving, 1.0, 0.0, work.dissipation)
    linearise(*moving, 0.0, 1.0, work.stiffness)
    linearise(*moving, 2e-3, 5e-6, work.matrix)
    np.testing.assert_array_equal(work.force, alone.force)
    np.testing.assert_array_equal(work.ledger, alone.ledger)
    np.testing.assert_array_equal(work.slip, alone.slip)
    together = 2e-3 * work.dissipation + 5e-6 * work.stiffness
    np.testing.assert_allclose(work.matrix, together, rtol=1e-9, atol=1e-13 * np.abs(together).max())


@pytest.mark.parametrize("name", SURFACES)
def test_spheres_that_part_leave_no_slip(name):
    surface, count, position = SURFACES[name]
    assembly = _pair(surface, count, position)
    state, work = assembly.initial_state(), assembly.work()
    generalized_forces(assembly.tables, work, state.positions, state.velocities)
    assert np.any(work.slip)
    assert work.touching[0, 0] == 1
    state.positions[1, 1:3] *= 0.5 if isinstance(surface, Cylinder) and surface.concave else 1.5
    generalized_forces(assembly.tables, work, state.positions, state.velocities)
    assert not np.any(work.slip)
    assert work.touching[0, 0] == 0
    np.testing.assert_array_equal(work.force, 0)


def test_rows_of_more_than_eight_spheres_are_the_sum_of_shorter_ones():
    """Twenty spheres of a row on a cylinder are four rows of five."""

    def work(rows):
        body = Body(
            "needle",
            1.0,
            (1.0,) * 3,
            position=(0.2, 3.0, 3.996),
            velocity=(1.0, -0.5, 0.1),
            angular_velocity=(0.3, 0.2, 0.4),
            attitude=(1.0, 0.0, 0.001, 0.0),
        )
        count, length = 20 // rows, 3.0 / rows
        places = [(k + 0.5) * length - 1.5 for k in range(rows)]
        contacts = tuple(
            SphereRow(
                "needle",
                Cylinder("base", 4.0),
                1.0,
                1e5,
                exponent=10 / 9,
                count=count,
                length=length,
                centre=(place, 0.0, 0.0),
                damping=0.01,
                friction=FRICTION,
            )
            for place in places
        )
        assembly = assemble(Scene((body, Body("base", 1.0, (1.0,) * 3)), contacts=contacts))
        state, memory = assembly.initial_state(), assembly.work()
        linearise(assembly.tables, memory, state.positions, state.velocities, 1.0, 1e-3, 1e-6, memory.matrix)
        return memory

    whole, parts = work(1), work(4)
    for name in ("force", "matrix", "ledger"):
        expected = getattr(parts, name)
        np.testing.assert_allclose(
            getattr(whole, name), expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max(), err_msg=name
        )
    assert np.count_nonzero(whole.slip[:, 0]) == np.count_nonzero(parts.slip[:, 0]) == 20


def test_the_core_is_eliminated_last():
    bodies = tuple(Body(name, 1.0, (1.0,) * 3) for name in ("a", "b", "c", "d"))
    pairs = [("b", "d"), ("a", "b"), ("d", GROUND), ("c", "a"), ("b", GROUND), ("c", "d")]
    rows = tuple(SphereRow(body, Plane(surface), 1.0, 1e5, count=k + 7) for k, (body, surface) in enumerate(pairs))
    assembly = assemble(Scene(bodies, contacts=rows, core=("b", "d")))
    pattern = assembly.tables.pattern
    assert {assembly.names[1 + row] for row in pattern.order[pattern.tail :]} == {"b", "d"}
