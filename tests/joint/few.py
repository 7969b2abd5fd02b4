"""A joint of few needles for tests."""

FEW = {"needle_count": 9, "needle_diameter_mm": 5.89, "spheres_per_needle": 3}
"""A full complement of few thick needles: every contact of the full joint at a tenth of its price."""

CALM = {"relative_tolerance": 1e-3}
"""With which they rattle a fifth as much as at the default, where that is an error of 5 % of the third order."""
