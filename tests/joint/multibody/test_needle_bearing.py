"""The bearing element of the mechanics against the load zone that `equilibrium` uses, solved by another way."""

from __future__ import annotations

import pytest

from tripod_doe.joint.derived_constants import load_zone
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.scene import GROUND, Body, Cylinder, Friction, NeedleBearing, Scene
from tripod_doe.mechanics.solve.equations_of_motion import generalized_forces


@pytest.mark.parametrize("load", [50.0, 800.0, 4000.0])
@pytest.mark.parametrize("clearance", [-0.003, 0.0, 0.002, 0.015, 0.1])
def test_element_has_the_load_zone_of_the_equilibrium(load, clearance):
    """Exact physics: the same displacement carries the same load, and all needles in sum carry kappa times it."""
    stiffness, count, along = 6.3e5, 27, (0.0, 0.0, 1.0)
    kappa, penetration = load_zone.bearing_load_zone(load, clearance, stiffness, count)
    roller = Body("roller", 1.0, (1.0,) * 3, position=(-clearance - 2 * penetration, 0.0, 0.0), velocity=along)
    element = NeedleBearing(
        Cylinder(GROUND, 7.64, axis=along),
        Cylinder("roller", 9.64 + clearance, axis=along, concave=True),
        2.0,
        10.0,
        count,
        stiffness / 7,
        friction=Friction(0.03, 1e-3),
    )
    assembly = assemble(Scene((roller,), bearings=(element,)))
    state, work = assembly.initial_state(), assembly.work()
    generalized_forces(assembly.tables, work, state.positions, state.velocities)
    assert work.force[1, 0] == pytest.approx(load, rel=1e-4)
    assert -work.force[1, 2] / 0.03 / work.force[1, 0] == pytest.approx(kappa, rel=1e-4)
