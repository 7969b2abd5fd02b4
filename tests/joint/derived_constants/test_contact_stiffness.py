"""Contact constants against printed numbers (FACTS, paper Table 1)."""

from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.joint.derived_constants import contact_stiffness


def test_a_groove_contact_is_as_stiff_as_printed():
    """Published number: FACTS, the ellipse of 20 to 1 under the reference roller."""
    constants = contact_stiffness.contact_constants(*(np.array([x]) for x in (1.0, 16.0, 1.008573, 10.0)))
    assert constants["groove_stiffness"][0] == pytest.approx(2.938e6, rel=1e-4)


def test_printed_constants_of_table_1_and_equations_5_to_8():
    """Published number: Eq. 5, 7 and 8 solved for C agree with Table 1 to their printed digits."""
    assert pytest.approx(2.15e5, rel=3e-3) == 2.79e-4 ** (-1.5)
    assert pytest.approx(8.15e4, rel=1e-3) == (3.8e-5) ** (-10 / 9)
    assert pytest.approx(8.85e-3, rel=1e-3) == 3 / 8 * 0.0472 / 2
    assert contact_stiffness.needle_contact_stiffness(np.array(10.0), np.array(1.0)) == pytest.approx(
        8.15e4 * 10 ** (8 / 9)
    )


def test_stiffer_steel_scales_the_constants():
    """Contract: proportional to E / (1 - nu^2)."""
    elastic = contact_stiffness.elastic_factor(np.array(414e3), np.array(0.3))
    assert elastic == pytest.approx(2)
    assert contact_stiffness.groove_contact_stiffness(np.array(0.44), np.array(0.063), elastic) == pytest.approx(
        2 * contact_stiffness.groove_contact_stiffness(np.array(0.44), np.array(0.063), np.array(1.0))
    )
    assert contact_stiffness.needle_contact_stiffness(np.array(10.0), elastic) == pytest.approx(
        2 * contact_stiffness.needle_contact_stiffness(np.array(10.0), np.array(1.0))
    )
