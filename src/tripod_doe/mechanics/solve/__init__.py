"""Solving the equations of motion: accelerations, Newton's iteration of an implicit step, block elimination."""
