"""Pairing of the magnetometer with the inertial samples, over whole recordings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stateful_ahrs.filters.samples import Samples, pair

MS = 1_000_000  # ns


def paired(
    stamps: list[int], mag_stamps: list[int], received: list[int] | None = None
) -> list[float]:
    """The number of the magnetometer sample that each inertial sample got; NaN for none."""
    numbers = np.arange(len(mag_stamps), dtype=float)
    nothing = np.zeros((len(stamps), 3))
    samples: Samples = pair(
        MS * np.array(stamps, dtype=np.int64),
        nothing,
        nothing,
        MS * np.array(mag_stamps, dtype=np.int64),
        np.repeat(numbers[:, None], 3, axis=1),
        None if received is None else np.array(received, dtype=np.int64),
    )
    return [float(row[0]) for row in samples.mag]


NONE = float("nan")


def same(found: list[float], expected: list[float]) -> bool:
    return np.array_equal(found, expected, equal_nan=True)


def test_a_magnetometer_sample_belongs_to_the_first_inertial_sample_not_older():
    assert same(paired([10, 20, 30, 40], [11, 30]), [NONE, 0, 1, NONE])


def test_of_several_between_two_inertial_samples_the_newest_is_taken():
    assert same(paired([10, 20], [1, 2, 13, 14, 15]), [1, 4])


def test_without_a_magnetometer_no_inertial_sample_is_lost():
    assert same(paired([10, 20, 30], []), [NONE] * 3)


def test_a_sample_that_is_not_finite_does_not_displace_one_that_is():
    mag = np.array([[1.0, 2.0, 3.0], [np.nan, 0.0, 0.0]])
    samples = pair(np.array([10, 20]), np.zeros((2, 3)), np.zeros((2, 3)), np.array([12, 13]), mag)
    assert samples.mag[1].tolist() == [1.0, 2.0, 3.0]


def test_a_sample_received_just_after_its_inertial_sample_still_belongs_to_it():
    assert same(paired([10, 20, 30], [10, 20, 30], received=[1, 2, 3]), [0, 1, 2])


def test_a_sample_received_too_late_goes_to_the_next_inertial_sample():
    assert same(paired([10, 20, 30, 40], [10], received=[3]), [NONE, NONE, NONE, 0])


@given(loops=st.integers(2, 5), mag_step=st.integers(3, 40))
def test_every_pass_of_a_looped_recording_is_paired_as_the_first(loops, mag_step):
    stamps = list(range(1000, 2000, 10))
    mag_stamps = list(range(1000, 1991, mag_step))
    before = np.searchsorted(stamps, mag_stamps)
    received = np.concatenate([before + n * len(stamps) for n in range(loops)]).tolist()
    found = np.array(paired(stamps * loops, mag_stamps * loops, received)).reshape(loops, -1)
    for n in range(loops):
        assert same(found[n] - n * len(mag_stamps), paired(stamps, mag_stamps))


def test_stamps_that_jump_back_do_not_tell_what_came_first():
    with pytest.raises(ValueError, match="jump back"):
        paired([10, 20, 10, 20], [10, 20, 10, 20])


def test_a_step_back_of_one_stream_alone_costs_no_more_than_its_samples():
    stamps = [10, 20, 30, 25, 40, 50, 60]
    mag_stamps = [10, 20, 30, 40, 50, 60]
    found = paired(stamps, mag_stamps, received=[0, 1, 2, 4, 5, 6])
    assert same(found, [0, 1, 2, NONE, 3, 4, 5])
