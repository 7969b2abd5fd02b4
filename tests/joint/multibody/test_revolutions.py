"""Revolutions of a joint: their waveforms at the samples that are asked for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import resample

from tripod_doe.joint.multibody.revolutions import _filtered


@pytest.mark.parametrize(("given", "samples"), [(1080, 360), (360, 360), (105, 35), (36, 36), (90, 30)])
def test_a_waveform_at_fewer_samples_is_that_of_scipy(given, samples):
    waveform = np.random.default_rng(3).normal(size=(3, given))
    fewer = resample(waveform, samples, axis=-1) if samples < given else waveform
    np.testing.assert_allclose(_filtered(waveform, samples), fewer, atol=1e-13)
