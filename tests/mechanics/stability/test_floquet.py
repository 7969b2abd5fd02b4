"""Growth of departures from a motion, against the eigenvalues of the same motion by hand (exact physics)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from example_scenes import pendulum

from tripod_doe.mechanics import scene as parts
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.run import Limits, run
from tripod_doe.mechanics.stability.floquet import departure_matrices, fastest_growth

MASS, SPRING, CONTACT, LOAD, SLIP = 1e-3, 60.0, 40.0, 10.0, 1e3
INCLINED = math.radians(150)
UNCHECKED = Limits(energy=math.inf, reversals=1.0, error=math.inf, windows=0)


def block_on_belt(friction: float):
    """A block held by an inclined spring that slides on a belt: the pair of modes that friction can couple."""
    depth, length = LOAD / CONTACT, 1e4  # a spring so long that it hardly turns
    along = np.array([math.cos(INCLINED), 0.0, math.sin(INCLINED)])
    block = parts.Body(
        "block",
        MASS,
        (1.0, 1.0, 1.0),
        position=(0.0, 0.0, 1.0 - depth),
        force=(-friction * LOAD, 0.0, -LOAD),
        locked=(False, True, False, True, True, True),
    )
    belt = parts.Body("belt", 1.0, (1.0, 1.0, 1.0), velocity=(SLIP, 0.0, 0.0), locked=(True,) * 6)
    touch = parts.SphereRow(
        "block", parts.Plane("belt"), 1.0, CONTACT, exponent=1.0, friction=parts.Friction(friction, 1.0)
    )
    anchor = tuple(float(x) for x in np.array(block.position) + length * along)
    spring = parts.Spring("block", parts.GROUND, SPRING, length, point_b=anchor)
    return assemble(parts.Scene((belt, block), contacts=(touch,), springs=(spring,), length_scale=depth))


def rates_by_hand(friction: float):
    """Eigenvalues of m u'' + K u = 0; friction pulls the block along the belt by mu times what its contact gives."""
    c, s = math.cos(INCLINED), math.sin(INCLINED)
    stiffness = SPRING * np.array([[c * c, c * s], [c * s, s * s]]) + CONTACT * np.array([[0, friction], [0, 1]])
    return np.sqrt(np.linalg.eigvals(-stiffness / MASS).astype(complex))


def growth_through(assembly, states, duration):
    """How departures grow in a motion through these states."""
    return fastest_growth(departure_matrices(assembly, states), duration)


@pytest.mark.parametrize("friction", [0.1, 0.8])
def test_friction_couples_two_modes(friction):
    """Below the border both modes swing on; above it one grows (Hoffmann et al. 2002, Mech. Res. Commun. 29)."""
    assembly, duration = block_on_belt(friction), 0.05
    growth = growth_through(assembly, [assembly.initial_state()] * 3, duration)
    fastest = max(rates_by_hand(friction), key=lambda rate: abs(rate.real))
    grows = abs(fastest.real) > 1e-6
    assert grows == (friction == 0.8)
    assert growth.rate == pytest.approx(abs(fastest.real) if grows else 0.0, rel=1e-4, abs=1e-2)
    assert growth.factor == pytest.approx(math.exp(growth.rate * duration))
    assert not grows or growth.frequency == pytest.approx(abs(fastest.imag), rel=1e-4)


@pytest.mark.parametrize("count", [3, 300])
def test_growth_beyond_all_numbers_keeps_its_rate(count):
    """Slow points: a revolution lasts so long that the growth, or that of one part of it, cannot be represented."""
    assembly = block_on_belt(0.8)
    growth = growth_through(assembly, [assembly.initial_state()] * count, 200.0)
    assert growth.rate == pytest.approx(max(abs(rate.real) for rate in rates_by_hand(0.8)), rel=1e-3)
    assert growth.factor == pytest.approx(math.exp(709))


@pytest.mark.slow
def test_an_undamped_run_grows_as_fast_and_a_damping_one_hides_it():
    assembly = block_on_belt(0.8)
    calm = assembly.initial_state()
    growth = growth_through(assembly, [calm], 1.0)
    duration = 18 * math.pi / growth.frequency  # thirds of it are whole numbers of half periods
    start = calm.copy()
    start.positions[2, 2] += 1e-6
    departures = {}
    for method, step, samples in (("generalized-alpha", 1e-5, 600), ("implicit-euler", 1e-2, 1)):
        result = run(assembly, method, duration, step=step, samples=samples, limits=UNCHECKED, start=start)
        departures[method] = np.linalg.norm((result.positions - calm.positions)[:, 2, :3:2], axis=1)
    middle, end = (departures["generalized-alpha"][part].max() for part in (slice(200, 400), slice(400, 600)))
    assert math.log(end / middle) == pytest.approx(growth.rate * duration / 3, rel=0.01)
    assert departures["implicit-euler"][-1] < 0.1 * departures["implicit-euler"][0]


def test_departures_are_carried_from_state_to_state():
    """What grows by a factor in one stretch grows by its square in two."""
    assembly, duration = block_on_belt(0.8), 0.03
    once, twice = (
        growth_through(assembly, [assembly.initial_state()] * count, count * duration).factor for count in (1, 2)
    )
    assert once > 2
    assert twice == pytest.approx(once**2, rel=1e-6)


@pytest.mark.parametrize(("height", "rate"), [(-1.0, 0.0), (1.0, math.sqrt(9.81))])
def test_a_pendulum_swings_on_or_falls_over(height, rate):
    """Hanging, it swings on; standing, it falls over at sqrt(g / l). That its constraints are kept adds nothing."""
    assembly = assemble(pendulum())
    state = assembly.initial_state()
    state.positions[1, :3] = (0.0, height, 0.0)
    state.velocities[:] = 0.0
    assert growth_through(assembly, [state] * 4, 1.0).rate == pytest.approx(rate, rel=1e-3, abs=1e-2)


def test_departures_are_those_of_independent_coordinates():
    """Exact: a swinging pendulum by its coordinate x = sin(angle), which its height follows, and its three turns."""
    assembly, angle, speed, g = assemble(pendulum()), 0.4, 3.0, 9.81
    state, c, s = assembly.initial_state(), math.cos(angle), math.sin(angle)
    state.positions[1, :3], state.velocities[1, :3] = (s, -c, 0.0), (speed * c, speed * s, 0.0)
    matrix = departure_matrices(assembly, [state])[0]
    assert matrix.shape == (8, 8)
    # a departure of x is that of the angle times c, which changes at the rate of c' with angle'' = -g s
    first, second = -s * speed / c, -(speed**2) + g * s * s / c
    by_place, by_velocity = -g * c + second - 2 * first**2, 2 * first
    assert matrix[4, [0, 4]] == pytest.approx([by_place, by_velocity], rel=1e-4)
