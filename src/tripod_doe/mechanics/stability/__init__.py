"""Stability of motions and steps: linearisation of a scene, its fastest rates, Floquet multipliers; no scene is run."""
