"""What implicit methods share: the system matrix M + a D + b K with constraints, and one implicit stage.

D = -dQ/dv and K = -dQ/dq. With the secant (lagged) slope of friction a stage converges where Newton's method with the
exact tangent diverges: the tangent of tanh is almost zero in slip, so the linear model sees no friction at all
(Drake's TAMSI and "lagged" contact models). But where a body slips at both of its contacts nothing but the tangents
decides where it settles, and the secant iteration contracts by 1 - tangent/secant only. So an iteration that has
become slow lowers the share of the secant below which no slope may fall, and raises it again when its corrections
grow.
"""

from __future__ import annotations

import math

from tripod_doe.mechanics.compilation import kernel
from tripod_doe.mechanics.constraints import evaluate_constraints, factorise_schur, solve_schur
from tripod_doe.mechanics.elimination import factorise, solve
from tripod_doe.mechanics.motion import (
    add_mass_blocks,
    add_mass_product,
    add_reaction_power,
    clear,
    constraint_rate,
    generalized_forces,
    larger,
    linearise,
)  # fmt: skip
from tripod_doe.mechanics.rotations import load_vector, move, tangent_rate

__all__ = [
    "factorise_system",
    "gather",
    "largest_correction",
    "scatter",
    "solve_stage",
    "solve_system",
    "solve_unconstrained",
]

_SLOW = 0.3
"""Contraction above which an iteration is slow."""

_ROUNDING = 1e3
"""Corrections below this many tolerances that no longer fall are rounding: stiffness times a position's last digit."""


@kernel
def factorise_system(tables, work, positions, by_velocity, by_position):
    """Form and factorise M + by_velocity D + by_position K; locked components become identities.

    With constraints A^-1 Phi_q^T and the Schur complement are made too, from the Jacobian in `work`.

    Returns
    -------
    bool
        False if the matrix is singular.
    """
    work.counters[2] += 1
    pattern, matrix = tables.pattern, work.matrix
    for block in range(pattern.row.size):
        for i in range(6):
            for j in range(6):
                damped, stiff = work.dissipation[block, i, j], work.stiffness[block, i, j]
                matrix[block, i, j] = by_velocity * damped + by_position * stiff
    add_mass_blocks(tables, positions, matrix)
    for block in range(pattern.row.size):
        body = tables.bodies[tables.body_of_row[pattern.row[block]]]
        for d in range(6):
            if body.free[d] == 0.0:
                for e in range(6):
                    matrix[block, d, e] = 0.0
                if pattern.row[block] == pattern.column[block]:
                    matrix[block, d, d] = 1.0
    if not factorise(pattern, matrix, work.pair):
        return False
    if tables.rows.size > 0:
        _weigh_by_matrix(tables, work)
    return True


@kernel
def _weigh_by_matrix(tables, work):
    """A^-1 Phi_q^T of every constraint equation, and the factors of their Schur complement."""
    for k in range(tables.rows.size):
        row = tables.rows[k]
        clear(work.blocks.ravel())
        for side in range(2):
            body = tables.bodies[row.body_a if side == 0 else row.body_b]
            if body.block >= 0:
                for d in range(6):
                    work.blocks[body.block, d] += work.jacobian[k, 6 * side + d]
        _mask(tables, work.blocks)
        solve(tables.pattern, work.matrix, work.blocks)
        scatter(tables, work.blocks, work.weighted[k])
    factorise_schur(tables.rows, work.jacobian, work.weighted, work.schur, work.pivots)


@kernel
def scatter(tables, blocks, vectors):
    """Copy rows of the block matrix to bodies; zero for bodies without a row."""
    for i in range(tables.bodies.size):
        row = tables.bodies[i].block
        for d in range(6):
            vectors[i, d] = blocks[row, d] if row >= 0 else 0.0


@kernel
def gather(tables, vectors, factor, blocks):
    """Add `factor` times vectors of bodies, shape (body, 6 or more), to the rows of the block matrix."""
    for row in range(tables.body_of_row.size):
        for d in range(6):
            blocks[row, d] += factor * vectors[tables.body_of_row[row], d]


@kernel
def _mask(tables, blocks):
    """Set the components of locked velocities to zero."""
    for row in range(tables.body_of_row.size):
        for d in range(6):
            blocks[row, d] *= tables.bodies[tables.body_of_row[row]].free[d]


@kernel
def solve_unconstrained(tables, work, out):
    """Solve A x = `work.blocks` without constraints; right-hand sides of locked components are taken as zero.

    Parameters
    ----------
    out
        Receives x, shape (body, 6 or more).
    """
    _mask(tables, work.blocks)
    solve(tables.pattern, work.matrix, work.blocks)
    scatter(tables, work.blocks, out)


@kernel
def solve_system(tables, work, wanted, out):
    """Solve A x + Phi_q^T mu = `work.blocks` with Phi_q x = wanted, by a matrix from `factorise_system`.

    Right-hand sides of locked components are taken as zero.

    Parameters
    ----------
    wanted
        Shape (constraint equation,); overwritten.
    out
        Receives x, shape (body, 6).
    """
    solve_unconstrained(tables, work, out)
    if tables.rows.size == 0:
        return
    for k in range(tables.rows.size):
        wanted[k] = constraint_rate(tables.rows[k], work.jacobian[k], out) - wanted[k]
    solve_schur(work.schur, work.pivots, wanted, work.multipliers)
    for k in range(tables.rows.size):  # a reaction moves every body that contacts and springs join to its own two
        for i in range(tables.bodies.size):
            for d in range(6):
                out[i, d] -= work.multipliers[k] * work.weighted[k, i, d]


@kernel
def _displace(tables, start, base, reach, velocities, displacement, positions):
    """Positions at base + reach times the rate of displacement from `start`."""
    for i in range(tables.bodies.size):
        theta = load_vector(displacement[i], 3)
        rate = tangent_rate(theta, load_vector(velocities[i], 3))
        for d in range(3):
            displacement[i, d] = base[i, d] + reach * velocities[i, d]
            displacement[i, 3 + d] = base[i, 3 + d] + reach * rate[d]
        move(start[i], displacement[i], positions[i])


@kernel
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


@kernel
def solve_stage(tables, work, start, base, before, reach, factor, time, settings, positions, velocities):
    """Solve u = before + factor a(q, u) with q at base + reach u from `start`, by secant iterations.

    Parameters
    ----------
    start, base
        Positions that displacements count from, shape (body, 7), and the known part of the displacement, (body, 6).
    before
        Known part of the velocities, shape (body, 6).
    reach, factor
        The method's multiples of the step for positions and velocities.
    time
        Time of the stage.
    positions, velocities
        Receive the stage; the velocities hold the first guess.

    Returns
    -------
    bool
        Whether the iteration converged; if not, `work.failure` names the body and the size of its last correction.
    """
    displacement, change, wanted = work.stages[18], work.stages[17], work.gamma
    clear(displacement.ravel())
    for i in range(tables.bodies.size):
        for d in range(6):
            displacement[i, d] = base[i, d] + reach * velocities[i, d]
    share, merit, last = 1.0, math.inf, math.inf
    for _ in range(settings.iterations):
        work.counters[5] += 1
        _displace(tables, start, base, reach, velocities, displacement, positions)
        generalized_forces(tables, work, positions, velocities)
        linearise(tables, work, positions, velocities, share)
        if tables.rows.size > 0:
            evaluate_constraints(
                tables.rows, positions, velocities, time, work.phi, work.phi_t, work.gamma, work.jacobian
            )
            for k in range(tables.rows.size):
                wanted[k] = -work.phi[k] / reach
        if not factorise_system(tables, work, positions, factor, factor * reach):
            return False
        clear(work.blocks.ravel())
        for i in range(tables.bodies.size):
            for d in range(6):
                change[i, d] = before[i, d] - velocities[i, d]
        add_mass_product(tables, positions, change, 1.0, work.blocks)
        gather(tables, work.force, factor, work.blocks)
        solve_system(tables, work, wanted, change)
        for i in range(tables.bodies.size):
            for d in range(6):
                velocities[i, d] += change[i, d]
        correction = largest_correction(tables, change, work.failure)
        rounded = correction >= last and correction <= _ROUNDING * settings.correction
        last = correction
        if correction <= settings.correction or rounded:
            _displace(tables, start, base, reach, velocities, displacement, positions)
            add_reaction_power(tables, work, velocities, 1.0 / factor)
            return True
        if not math.isfinite(correction):
            return False
        before_merit, merit = merit, share * correction  # in full slip a correction grows as the slope falls
        if merit > before_merit:
            share = min(4.0 * share, 1.0)
        elif merit > _SLOW * before_merit:
            share = max(0.25 * share, 1e-6)
    return False
