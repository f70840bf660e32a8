"""The gyroscope's bias on request."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stateful_ahrs.filters.rest import MovedError, RestWindow

BIAS = (0.01, -0.02, 0.005)
NOISE = math.radians(0.1)  # rad/s, data sheet


def rested(seconds, rate=100, noise=NOISE, bias=BIAS):
    window = RestWindow()
    random = np.random.default_rng(3)
    for _ in range(round(seconds * rate)):
        window.add(tuple(np.array(bias) + random.normal(0.0, noise, 3)), 1.0 / rate)
    return window


@pytest.mark.parametrize("rate", [20, 100, 1000])
def test_bias_is_the_mean_rate_at_rest(rate):
    # 4 sigma of the mean of 2 s
    assert rested(3.0, rate).bias() == pytest.approx(BIAS, abs=4 * NOISE / math.sqrt(2 * rate))


def test_only_the_last_two_seconds_count():
    window = rested(5.0, bias=(1.0, 1.0, 1.0))
    for _ in range(200):
        window.add(BIAS, 0.01)
    window.add(BIAS, 0.01)
    assert window.bias() == pytest.approx(BIAS)


def test_too_short_a_rest_is_refused():
    with pytest.raises(MovedError, match=r"1\.\d s of gyroscope samples so far"):
        rested(1.5).bias()


@pytest.mark.parametrize("window", [rested(3.0, noise=0.1), rested(3.0, bias=(0.5, 0.0, 0.0))])
def test_motion_is_refused_with_its_rates(window):
    with pytest.raises(MovedError, match="the sensor moved: rates of"):
        window.bias()


@pytest.mark.parametrize(("rate", "dt"), [((math.nan, 0.0, 0.0), 0.01), (BIAS, 0.0)])
def test_a_restart_or_a_bad_sample_begins_the_rest_anew(rate, dt):
    window = rested(3.0)
    window.add(rate, dt)
    with pytest.raises(MovedError):
        window.bias()
