"""Newton's iteration of an implicit step: the system matrix M + a D + b K with constraints, and one implicit stage.

D = -dQ/dv and K = -dQ/dq. With the secant (lagged) slope of friction a stage converges where Newton's method with the
exact tangent diverges: the tangent of tanh is almost zero in slip, so the linear model sees no friction at all
(Drake's TAMSI and "lagged" contact models). But if a body slips at both of its contacts, only the tangents determine
its equilibrium, and the secant iteration contracts only by 1 - tangent/secant. So a slow iteration lowers the least
slope (a share of the secant), and raises it again when its corrections grow.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.arithmetic.rotations import load_vector, move, tangent_rate
from tripod_doe.mechanics.arithmetic.simd_lanes import clear
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel, kernel_part
from tripod_doe.mechanics.forces.constraints import evaluate_constraints, factorise_schur, solve_schur
from tripod_doe.mechanics.forces.inertia import (
    add_inertia_forces,
    add_inertia_matrices,
    add_mass_blocks,
    add_mass_product,
    add_momenta,
)
from tripod_doe.mechanics.solve.elimination import eliminate, reduce_right_side, substitute_back
from tripod_doe.mechanics.solve.equations_of_motion import add_reaction_power, copy_vectors, larger, linearise_elements
from tripod_doe.mechanics.tables import FACTORISATIONS, FIRST, ITERATIONS, Slopes

_SLOW = 0.3
"""Contraction above which an iteration is slow."""

LEAST_SHARE = 1e-6
"""Smallest share of the secant, below which slopes are tangents. An iteration with a loose tolerance keeps the secant:
rattling light bodies make it look slow, and tangents would throw them about."""

_ROUNDING = 1e-6
"""Corrections below this share of the scene's speed that no longer decrease are rounding: stiffness times a last
digit."""


@kernel_part
def factorise_system(tables, work, positions):
    """Add M to `work.matrix`, which holds a D + b K, and factorise it; locked components become identities.

    With constraints the Schur complement of their multipliers is made too, from the Jacobian in `work`.

    Returns:
        False if the matrix is singular.
    """
    work.counters[FACTORISATIONS] += 1
    add_mass_blocks(tables, positions, work.matrix)
    lock_blocks(tables, work.matrix)
    if not eliminate(tables.pattern, work.matrix, FIRST, tables.pattern.order.size, work.pair):
        return False
    if tables.rows.size > 0:
        factorise_multipliers(tables, work)
    return True


@kernel_part
def lock_blocks(tables, matrix):
    """Turn the rows of locked components into those of an identity."""
    pattern = tables.pattern
    for row in range(tables.body_of_row.size):
        body = tables.bodies[tables.body_of_row[row]]
        for d in range(6):
            if body.free[d] == 0.0:
                for block in range(pattern.row.size):
                    if pattern.row[block] == row:
                        for e in range(6):
                            matrix[block, d, e] = 0.0
                matrix[pattern.own[row], d, d] = 1.0


@kernel_part
def factorise_multipliers(tables, work):
    """Make A^-1 Phi_q^T and the factors of Phi_q A^-1 Phi_q^T; both live in the tail, where all constraints are."""
    pattern, blocks = tables.pattern, work.blocks
    first, last = pattern.tail, pattern.order.size
    for k in range(tables.rows.size):
        clear(blocks)
        for side in range(2):
            body = tables.bodies[tables.rows[k].body_a if side == 0 else tables.rows[k].body_b]
            if body.block >= 0:
                for d in range(6):
                    blocks[body.block, d] += body.free[d] * work.jacobian[k, 6 * side + d]
        reduce_right_side(pattern, work.matrix, blocks, first, last)
        substitute_back(pattern, work.matrix, blocks, first, last)
        for pivot in range(first, last):
            row = pattern.order[pivot]
            for d in range(6):
                work.weighted[k, tables.body_of_row[row], d] = blocks[row, d]
    factorise_schur(tables.rows, work.jacobian, work.weighted, work.schur, work.pivots)


@inlined_kernel
def scatter(tables, blocks, vectors):
    """Copy rows of the block matrix to bodies; zero for bodies without a row."""
    for i in range(tables.bodies.size):
        row = tables.bodies[i].block
        for d in range(6):
            vectors[i, d] = blocks[row, d] if row >= 0 else 0.0


@inlined_kernel
def gather(tables, vectors, factor, blocks):
    """Add `factor` times vectors of bodies, shape (body, 6 or more), to the rows of the block matrix."""
    for row in range(tables.body_of_row.size):
        for d in range(6):
            blocks[row, d] += factor * vectors[tables.body_of_row[row], d]


@inlined_kernel
def mask(tables, blocks):
    """Set the components of locked velocities to zero."""
    for row in range(tables.body_of_row.size):
        for d in range(6):
            blocks[row, d] *= tables.bodies[tables.body_of_row[row]].free[d]


@kernel
def solve_unconstrained(tables, work, out):
    """Solve A x = `work.blocks` without constraints; right-hand sides of locked components are taken as zero.

    Args:
        out: Receives x, shape (body, 6 or more).
    """
    count = tables.pattern.order.size
    mask(tables, work.blocks)
    reduce_right_side(tables.pattern, work.matrix, work.blocks, FIRST, count)
    substitute_back(tables.pattern, work.matrix, work.blocks, FIRST, count)
    scatter(tables, work.blocks, out)


@kernel_part
def solve_tail(tables, work, wanted):
    """Solve for the bodies of the tail, under the constraints, with `work.blocks` reduced through all before it.

    Args:
        wanted: Phi_q x, shape (constraint equation,); overwritten. `work.multipliers` receives mu.
    """
    pattern, blocks = tables.pattern, work.blocks
    first, last = pattern.tail, pattern.order.size
    reduce_right_side(pattern, work.matrix, blocks, first, last)
    substitute_back(pattern, work.matrix, blocks, first, last)
    for k in range(tables.rows.size):
        wanted[k] = -wanted[k]
        for side in range(2):
            row = tables.bodies[tables.rows[k].body_a if side == 0 else tables.rows[k].body_b].block
            if row >= 0:
                for d in range(6):
                    wanted[k] += work.jacobian[k, 6 * side + d] * blocks[row, d]
    if tables.rows.size > 0:
        solve_schur(work.schur, work.pivots, wanted, work.multipliers)
    for k in range(tables.rows.size):
        for pivot in range(first, last):
            row = pattern.order[pivot]
            for d in range(6):
                blocks[row, d] -= work.multipliers[k] * work.weighted[k, tables.body_of_row[row], d]


@kernel_part
def solve_system(tables, work, wanted, out):
    """Solve A x + Phi_q^T mu = `work.blocks` with Phi_q x = wanted, by a matrix from `factorise_system`.

    Right-hand sides of locked components are taken as zero.

    Args:
        wanted: Shape (constraint equation,); overwritten.
        out: Receives x, shape (body, 6 or more).
    """
    pattern = tables.pattern
    mask(tables, work.blocks)
    reduce_right_side(pattern, work.matrix, work.blocks, FIRST, pattern.tail)
    solve_tail(tables, work, wanted)
    substitute_back(pattern, work.matrix, work.blocks, FIRST, pattern.tail)
    scatter(tables, work.blocks, out)


class Stage(NamedTuple):
    """Data of a stage of an implicit method: p(q, u) = p_0 + factor Q(q, u) with q at base + reach u from `start`.

    p are the momenta in inertial axes (`inertia.add_momenta`), p_0 those in `Work.momenta`; or, for methods that know
    velocities `before` instead, p - p_0 = M (u - before) and Q holds the inertia forces too.
    """

    # start, base: positions that displacements count from, shape (body, 7), and the known part of the displacement,
    # (body, 6)
    start: FloatArray
    base: FloatArray
    before: FloatArray  # known velocities, shape (body, 6), or empty
    # reach, factor: the method's multiples of the step for positions and velocities
    reach: float
    factor: float
    time: float  # time of the stage


@inlined_kernel
def _displace(tables, stage, velocities, displacement, positions):
    """Positions at base + reach times the rate of displacement from `start`."""
    for i in range(tables.bodies.size):
        theta = load_vector(displacement[i], 3)
        rate = tangent_rate(theta, load_vector(velocities[i], 3))
        for d in range(3):
            displacement[i, d] = stage.base[i, d] + stage.reach * velocities[i, d]
            displacement[i, 3 + d] = stage.base[i, 3 + d] + stage.reach * rate[d]
        move(stage.start[i], displacement[i], positions[i])


@inlined_kernel
def largest_correction(tables, correction, failure):
    """Largest correction of a velocity relative to the scene's scales; notes its body in `failure`."""
    worst = 0.0
    for i in range(tables.bodies.size):
        for d in range(6):
            size = abs(correction[i, d]) / (tables.scales[1] if d < 3 else tables.scales[2])
            if not size <= worst:
                failure[0], failure[1] = i, size
            worst = larger(worst, size)
    return worst


@kernel_part
def _factorise_stage(tables, work, stage, share, positions, velocities):
    """Linearise and factorise the equations of a stage; `work.gamma` receives the constraints' right-hand side.

    Returns:
        False if the matrix is singular.
    """
    slopes = Slopes(share, stage.factor, stage.factor * stage.reach)
    linearise_elements(tables, work, positions, velocities, slopes, work.matrix)
    if stage.before.size > 0:
        add_inertia_forces(tables, work, positions, velocities)
        add_inertia_matrices(tables, positions, velocities, stage.factor, work.matrix)
    if tables.rows.size > 0:
        evaluate_constraints(
            tables.rows, positions, velocities, stage.time, work.phi, work.phi_t, work.gamma, work.jacobian
        )
        for k in range(tables.rows.size):
            work.gamma[k] = -work.phi[k] / stage.reach
    return factorise_system(tables, work, positions)


@kernel_part
def _correct(tables, work, stage, positions, velocities):
    """Solve the factorised equations of a stage for a correction of its velocities, and apply it."""
    if stage.before.size == 0:
        copy_vectors(work.momenta, work.blocks)
        add_momenta(tables, positions, velocities, -1.0, 0.0, work.blocks)
    else:
        clear(work.blocks)
        add_mass_product(tables, positions, stage.before, 1.0, work.blocks)
        add_mass_product(tables, positions, velocities, -1.0, work.blocks)
    gather(tables, work.force, stage.factor, work.blocks)
    solve_system(tables, work, work.gamma, work.change)
    for i in range(tables.bodies.size):
        for d in range(6):
            velocities[i, d] += work.change[i, d]


@kernel_part
def solve_stage(tables, work, stage, iterations, tolerance, least, positions, velocities):
    """Solve a stage by secant iterations.

    Args:
        stage: Data of the stage.
        iterations, tolerance: Largest number of iterations, and the relative correction of a velocity at which they
            end.
        least: Least share of the secant below which no slope may fall: `LEAST_SHARE`, or 1 to keep the secant.
        positions, velocities: Receive the stage; the velocities hold the first guess.

    Returns:
        Whether the iteration converged; if not, `work.failure` names the body and the size of its last correction.
    """
    displacement = work.displacement
    clear(displacement)
    for i in range(tables.bodies.size):
        for d in range(6):
            displacement[i, d] = stage.base[i, d] + stage.reach * velocities[i, d]
    share, merit, last = 1.0, math.inf, math.inf
    for _ in range(iterations):
        work.counters[ITERATIONS] += 1
        _displace(tables, stage, velocities, displacement, positions)
        if not _factorise_stage(tables, work, stage, share, positions, velocities):
            return False
        _correct(tables, work, stage, positions, velocities)
        correction = largest_correction(tables, work.change, work.failure)
        rounded = correction >= last and correction <= _ROUNDING
        last = correction
        if correction <= tolerance or rounded:
            _displace(tables, stage, velocities, displacement, positions)
            add_reaction_power(tables, work, positions, velocities, 1.0 / stage.factor)
            return True
        if not math.isfinite(correction):
            return False
        before_merit, merit = merit, share * correction  # in full slip a correction grows as the slope falls
        if merit > before_merit:
            share = min(4.0 * share, 1.0)
        elif merit > _SLOW * before_merit:
            share = max(0.25 * share, least)
    return False
