"""Tables: the typed contiguous form of a scene that kernels read, and the memory that they work in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.mechanics.compilation.by_reference import ByReference

_VECTOR = (np.float64, (3,))

BODY = np.dtype(
    [
        ("mass", np.float64),
        ("inertia", *_VECTOR),
        ("load", np.float64, (6,)),
        ("own_moment", *_VECTOR),
        ("free", np.float64, (6,)),  # 1 where a velocity component is free, 0 where it is locked
        ("block", np.int64),  # row in the block matrix, -1 for a body that never moves
    ],
    align=True,
)

CONTACT = np.dtype(
    [
        ("body_a", np.int64),  # carries the spheres
        ("body_b", np.int64),  # carries the surface
        ("count", np.int64),
        ("groups", np.int64),  # of eight spheres
        ("first", np.int64),  # number of the row's first group of eight spheres in the scene
        ("pair", np.int64, (4,)),  # blocks aa, ab, ba, bb of the block matrix, -1 where there is none
        ("sign", np.float64),  # 0 plane, +1 convex, -1 concave cylinder
        ("centre", *_VECTOR),
        ("axis", *_VECTOR),
        ("length", np.float64),
        ("radius", np.float64),
        ("crown", np.float64),
        ("point", *_VECTOR),
        ("direction", *_VECTOR),  # normal of the plane, axis of the cylinder
        ("across", *_VECTOR),  # a direction in the plane; unused for cylinders
        ("surface_radius", np.float64),
        ("stiffness", np.float64),
        ("exponent", np.float64),
        ("damping", np.float64),
        ("damping_time", np.float64),
        ("sliding", np.float64),
        ("sliding_transition", np.float64),
        ("rolling", np.float64),
        ("lever", np.float64),
        ("rolling_transition", np.float64),
        ("spinning", np.float64),
        ("spinning_transition", np.float64),
    ],
    align=True,
)

SPRING = np.dtype(
    [
        ("body_a", np.int64),
        ("body_b", np.int64),
        ("pair", np.int64, (4,)),
        ("point_a", *_VECTOR),
        ("point_b", *_VECTOR),
        ("stiffness", np.float64),
        ("damping", np.float64),
        ("free_length", np.float64),
    ],
    align=True,
)

LOAD_ZONE_NODES = 4
"""Points on half the load zone of a needle bearing: errors of its sums are 1e-7 without clearance, smaller with it."""

NEEDLE_BEARING = np.dtype(
    [
        ("body_a", np.int64),  # carries the trunnion
        ("body_b", np.int64),  # carries the bore
        ("pair", np.int64, (4,)),
        ("slices", np.int64),
        ("point_a", *_VECTOR),  # middle of the needles
        ("axis_a", *_VECTOR),
        ("across_a", *_VECTOR),  # any unit vector across the trunnion's axis
        ("point_b", *_VECTOR),
        ("axis_b", *_VECTOR),
        ("trunnion_radius", np.float64),
        ("bore_radius", np.float64),
        ("diameter", np.float64),
        ("clearance", np.float64),
        ("length", np.float64),
        ("crown", np.float64),
        ("density", np.float64),  # stiffness of all needles' slices per rad of the circumference
        ("exponent", np.float64),
        ("damping", np.float64),
        ("damping_time", np.float64),
        ("cosine", np.float64),  # of the skew
        ("skew_lever", np.float64),  # r_b r_t / r_p times its sine
        ("sliding", np.float64),
        ("sliding_transition", np.float64),
        ("rolling", np.float64),
        ("rolling_transition", np.float64),
        ("node", np.float64, (LOAD_ZONE_NODES,)),  # squares of the nodes
        ("weight", np.float64, (LOAD_ZONE_NODES,)),
    ],
    align=True,
)

IN_PLANE, PERPENDICULAR, DISTANCE = 0, 1, 2
"""Kinds of constraint equation; every joint is made of these three."""

CONSTRAINT_ROW = np.dtype(
    [
        ("kind", np.int64),
        ("body_a", np.int64),
        ("body_b", np.int64),
        ("point_a", *_VECTOR),
        ("point_b", *_VECTOR),
        ("direction_a", *_VECTOR),
        ("turned_a", *_VECTOR),  # direction_a turned by a right angle, for prescribed rotations
        ("direction_b", *_VECTOR),
        ("length", np.float64),
        ("motion", *_VECTOR),  # angle, rate and acceleration of a prescribed rotation
    ],
    align=True,
)

EVALUATIONS, LINEARISATIONS, FACTORISATIONS, STEPS, REJECTED, ITERATIONS, TRACED = range(7)
"""Entries of `Work.counters`: force evaluations, linearisations, factorisations, accepted and rejected steps,
iterations of implicit stages, and states in `Work.trace`."""

FIRST = np.int64(0)
"""The first row or pivot of a range. For a literal 0 numba would compile the kernel again with another type."""

LEDGER = ("elastic_energy", "input_power", "sliding", "spinning", "rolling", "damping")
"""Entries of the energy ledger: stored energy, power put in by loads and drives, and power lost by mechanism."""


class Slopes(NamedTuple):
    """Which derivatives of forces are wanted; with both factors zero, none."""

    # 1 for the secant (lagged) slope of every friction law, 0 for its exact tangent, and between them the tangent, at
    # least this share of the secant
    secant: float
    # by_velocity, by_position: factors of D = -dQ/dv and K = -dQ/dq in the block matrix
    by_velocity: float
    by_position: float


@dataclass(frozen=True, eq=False)
class Pattern(ByReference):
    """Elimination of the block matrix, worked out once: which 6 x 6 blocks exist, and what each pivot does."""

    diagonal: IntArray  # block number of each pivot, in order of elimination, shape (pivot,)
    order: IntArray  # row of each pivot, shape (pivot,)
    start: IntArray  # where each pivot's neighbours begin, shape (pivot + 1,)
    # neighbour, lower, upper: row of each neighbour, and the blocks (neighbour, pivot) and (pivot, neighbour)
    neighbour: IntArray
    lower: IntArray
    upper: IntArray
    # target_start, target: blocks (i, j) that a pivot's neighbours i and j update, i slowest
    target_start: IntArray
    target: IntArray
    own: IntArray  # diagonal block of each row
    # row, column: place of every block
    row: IntArray
    column: IntArray
    # tail, tail_block: first pivot of the tail, the bodies that are eliminated last, and first block of the rows and
    # columns that only they have; all later blocks are of this kind too
    tail: int
    tail_block: int


@dataclass(frozen=True, eq=False)
class Tables(ByReference):
    """Everything a kernel reads about a scene."""

    bodies: NDArray[Any]
    contacts: NDArray[Any]
    springs: NDArray[Any]
    bearings: NDArray[Any]
    rows: NDArray[Any]
    gravity: FloatArray
    frame: FloatArray  # angular velocity of the world axes
    scales: FloatArray  # length, speed, angular velocity, time
    body_of_row: IntArray
    pattern: Pattern


@dataclass(frozen=True, eq=False)
class Work(ByReference):
    """Memory of one run, allocated once."""

    # force, acceleration: generalized force and acceleration, shape (body, 6)
    force: FloatArray
    acceleration: FloatArray
    ledger: FloatArray  # energies and powers at the last force evaluation (`LEDGER`)
    # slip, slip_before: slip vector of every sphere, in groups of eight, at the last force evaluation and at the last
    # accepted step, shape (group, 3, 8)
    slip: FloatArray
    slip_before: FloatArray
    touching: IntArray  # whether a contact's slips may differ from zero, at the same two times, shape (contact, 2)
    # stiffness, dissipation, matrix: block matrices -dQ/dq and -dQ/dv, for methods that need them apart, and the one
    # that is factorised, shape (block, 6, 8); the last two columns are zeros, so that a row is as wide as a register
    stiffness: FloatArray
    dissipation: FloatArray
    matrix: FloatArray
    # phi, phi_t, gamma, jacobian, weighted, schur, multipliers, pivots: constraint equations: residuals, partial time
    # derivatives, right-hand side of Eq. 1, Phi_q as (row, 12), its product with the inverse matrix (row, body, 6),
    # Schur complement, lambda, and the order of its pivots.
    phi: FloatArray
    phi_t: FloatArray
    gamma: FloatArray
    jacobian: FloatArray
    weighted: FloatArray
    schur: FloatArray
    multipliers: FloatArray
    pivots: IntArray
    # A right-hand side of the block solver, shape (row, 8); the last two columns only fill the lanes
    blocks: FloatArray
    momenta: FloatArray  # known part of the momenta in an implicit stage, shape (row, 8), the last two columns unused
    # displacement, change: displacements of an implicit stage from its start, and the correction of its velocities,
    # shape (body, 8)
    displacement: FloatArray
    change: FloatArray
    nothing: FloatArray  # no velocities, shape (0, 8): for implicit stages that know momenta instead
    # memory of a method for positions, increments and velocities, shape (17, body, 8); each method names its own
    stages: FloatArray
    pair: FloatArray  # scratch for one pair of bodies, shape (2, 6, 8)
    counters: IntArray  # counted work, and how full the trace is: `EVALUATIONS` to `TRACED`
    # balance, power_before: time integrals of ledger entries 1 to 5, and their values at the last accepted step
    balance: FloatArray
    power_before: FloatArray
    motion_before: FloatArray  # places and velocities of all bodies at the last accepted step, shape (body, 6)
    paths: FloatArray  # slip path of every sphere, in steps that reversed its slip and in all, shape (group, 2, 8)
    extremes: FloatArray  # largest constraint drift
    failure: FloatArray  # body and size of the correction or speed that stopped a run
    # states after the last steps: time, positions and velocities in a row, shape (state, 1 + 13 x bodies); without rows
    # none are kept
    trace: FloatArray
