"""Magnetometer samples find their inertial samples in whatever order they arrive."""

from __future__ import annotations

import numpy as np
import pytest

from stateful_ahrs.filters.pairing import Pairing
from stateful_ahrs.filters.stamps import SECOND

FIELDS = [(float(i), 0.0, 0.0) for i in range(100)]
PERIOD = SECOND // 100


def stamp(i):
    return SECOND * 1000 + i * PERIOD


def test_a_pair_is_found_when_the_magnetometer_comes_first():
    pairing = Pairing()
    for i in range(5):
        assert not pairing.add(stamp(i), FIELDS[i])
        assert pairing.take(stamp(i)) == FIELDS[i]
    assert pairing.superseded == 0


def test_a_magnetometer_sample_that_comes_second_amends_the_step():
    pairing = Pairing()
    for i in range(5):
        assert pairing.take(stamp(i)) is None
        assert pairing.add(stamp(i), FIELDS[i])
    assert pairing.superseded == 0


def test_magnetometer_samples_ahead_wait_for_their_time():
    pairing = Pairing()
    for i in range(10):
        pairing.add(stamp(i), FIELDS[i])
    assert [pairing.take(stamp(i)) for i in range(10)] == FIELDS[:10]


def test_of_several_between_two_inertial_samples_the_newest_is_taken_and_the_rest_counted():
    pairing = Pairing()
    for i in (1, 2, 3):
        pairing.add(stamp(i), FIELDS[i])
    assert pairing.take(stamp(3)) == FIELDS[3]
    assert pairing.superseded == 2


def test_a_sample_between_two_inertial_ones_goes_to_the_later():
    pairing = Pairing()
    pairing.take(stamp(0))
    pairing.take(stamp(2))
    assert pairing.add(stamp(1), FIELDS[1])


def test_a_sample_older_than_the_last_used_is_counted():
    pairing = Pairing()
    pairing.add(stamp(5), FIELDS[5])
    pairing.take(stamp(5))
    assert not pairing.add(stamp(4), FIELDS[4])
    assert pairing.superseded == 1


@pytest.mark.parametrize("mag_first", [True, False])
def test_a_looped_bag_pairs_from_its_first_sample(mag_first):
    pairing = Pairing()
    for _ in range(2):
        for i in range(50):
            if i == 0 and not mag_first:
                pairing.restart(stamp(0))
                assert pairing.take(stamp(0)) is None
                assert pairing.add(stamp(0), FIELDS[0])
                continue
            pairing.add(stamp(i), FIELDS[i])
            if i == 0:
                pairing.restart(stamp(0))
            assert pairing.take(stamp(i)) == FIELDS[i]
    assert pairing.superseded == 0


def test_a_restart_forgets_samples_of_another_time():
    pairing = Pairing()
    pairing.add(stamp(5000), FIELDS[1])
    pairing.restart(stamp(0))
    assert pairing.take(stamp(0)) is None
    assert pairing.take(stamp(5000)) is None
    assert pairing.superseded == 1


def test_a_second_sample_for_one_step_supersedes_the_first():
    pairing = Pairing()
    pairing.take(stamp(0))
    pairing.take(stamp(10))
    assert pairing.add(stamp(5), FIELDS[1])
    assert pairing.add(stamp(6), FIELDS[2])
    assert pairing.superseded == 1


@pytest.mark.parametrize(("delay", "late"), [(0.02, 0), (0.1, 1)])
def test_what_comes_too_late_tells_another_heading_and_is_counted(delay, late):
    pairing = Pairing()
    for i in range(30):
        pairing.take(stamp(i))
    pairing.add(stamp(30) - round(delay * SECOND), FIELDS[0])
    assert pairing.take(stamp(30)) == (None if late else FIELDS[0])
    assert pairing.late == late


def test_a_slow_sensor_is_not_late():
    pairing = Pairing()
    for i in range(5):
        pairing.add(stamp(20 * i) - 9 * PERIOD, FIELDS[i])
        assert pairing.take(stamp(20 * i)) == FIELDS[i]


def test_one_stamp_far_ahead_does_not_hold_up_the_others():
    pairing = Pairing()
    pairing.add(stamp(10_000), FIELDS[0])
    for i in range(10):
        pairing.add(stamp(i), FIELDS[i])
        assert pairing.take(stamp(i)) == FIELDS[i]


def test_a_magnetometer_without_inertial_samples_takes_bounded_memory():
    pairing = Pairing()
    for i in range(5000):
        pairing.add(stamp(i), FIELDS[0])
    assert pairing.superseded == 4000


def test_live_pairing_gives_what_a_recording_gives():
    from stateful_ahrs.filters.samples import pair

    random = np.random.default_rng(1)
    imu = np.cumsum(random.integers(1, 3, 200)) * PERIOD
    mag = np.unique(random.integers(0, imu[-1], 150))
    field = random.normal(size=(len(mag), 3))
    zeros = np.zeros((len(imu), 3))
    before = np.searchsorted(imu, mag)
    recorded = pair(imu, zeros, zeros, mag, field, before).mag
    pairing = Pairing()
    for m, v in zip(mag.tolist(), field.tolist(), strict=True):
        pairing.add(m, tuple(v))
    live = [pairing.take(t) or (np.nan,) * 3 for t in imu.tolist()]
    assert np.array(live) == pytest.approx(recorded, nan_ok=True)
