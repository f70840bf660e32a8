"""Stamps that stand still, jump, or are missing."""

from __future__ import annotations

import numpy as np
import pytest

from stateful_ahrs.filters.stamps import SECOND, ZEROS_BEFORE_ARRIVAL, StampGate, steps

START = 1_700_000_000 * SECOND
PERIOD = SECOND // 100


def fed(*stamps):
    gate = StampGate()
    return gate, [gate.step(stamp) for stamp in stamps]


def test_the_first_sample_starts_and_the_next_ones_step():
    _, found = fed(START, START + PERIOD, START + 3 * PERIOD)
    assert found == [0.0, pytest.approx(0.01), pytest.approx(0.02)]


def test_a_duplicate_is_skipped_and_counted():
    gate, found = fed(START, START, START + PERIOD)
    assert found == [0.0, None, pytest.approx(0.01)]
    assert gate.counts.duplicate == 1


def test_a_late_sample_is_skipped_and_the_step_after_it_spans_it():
    gate, found = fed(START, START + 2 * PERIOD, START + PERIOD, START + 3 * PERIOD)
    assert found == [0.0, pytest.approx(0.02), None, pytest.approx(0.01)]
    assert gate.counts.out_of_order == 1


@pytest.mark.parametrize(
    ("jump", "kind"),
    [(-2 * SECOND, "jumps_back"), (2 * SECOND, "gaps"), (-START + 1, "jumps_back")],
)
def test_a_jump_starts_anew_from_the_sample_after_it(jump, kind):
    gate, found = fed(START, START + PERIOD, START + jump, START + jump + PERIOD)
    assert found == [0.0, pytest.approx(0.01), 0.0, pytest.approx(0.01)]
    assert getattr(gate.counts, kind) == 1
    assert gate.last == START + jump + PERIOD


def test_a_jump_is_told_with_its_length():
    gate, _ = fed(START, START - 5 * SECOND)
    assert gate.news == ("back", "IMU stamps jump back by 5.000 s: starting anew.")


def test_after_a_jump_of_the_clock_even_a_short_step_back_starts_anew():
    gate = StampGate()
    gate.step(START)
    gate.clock_jumped()
    assert gate.step(START - PERIOD) == 0.0
    assert gate.step(START - 3 * PERIOD) is None  # only the first
    assert gate.counts.out_of_order == 1


def test_a_jump_of_the_clock_that_the_stamps_do_not_follow_is_forgotten():
    gate = StampGate()
    gate.step(START)
    gate.clock_jumped()
    for i in range(1, 110):
        gate.step(START + i * PERIOD)
    assert gate.step(START + 108 * PERIOD) is None
    assert gate.counts.jumps_back == 0


def test_one_zero_stamp_among_good_ones_is_skipped():
    gate, found = fed(START, 0, START + PERIOD)
    assert found == [0.0, None, pytest.approx(0.01)]
    assert gate.counts.zero == 1


def test_a_sender_that_never_stamps_is_taken_by_time_of_arrival():
    gate = StampGate()
    assert [gate.step(0, START + i * PERIOD) for i in range(3)] == [
        0.0,
        pytest.approx(0.01),
        pytest.approx(0.01),
    ]
    assert gate.counts.zero == 3


def test_a_sender_that_stops_stamping_is_taken_by_time_of_arrival_after_a_while():
    gate = StampGate()
    gate.step(START)
    found = [gate.step(0, 5 * START + i * PERIOD) for i in range(ZEROS_BEFORE_ARRIVAL + 1)]
    assert found[:-2] == [None] * (ZEROS_BEFORE_ARRIVAL - 1)
    assert found[-2:] == [0.0, pytest.approx(0.01)]


def test_a_sender_that_begins_to_stamp_starts_anew():
    gate = StampGate()
    gate.step(0, 5 * START)
    assert gate.step(START) == 0.0
    assert gate.step(START + PERIOD) == pytest.approx(0.01)


@pytest.mark.parametrize(
    "stamps",
    [
        [START + i * PERIOD for i in range(10)],
        [START, START, START - PERIOD, START + PERIOD, START - 2 * SECOND, START + 9 * SECOND],
        [START],
        [],
    ],
)
def test_a_recording_steps_as_a_live_stream(stamps):
    live = [step if step is not None else np.nan for step in fed(*stamps)[1]]
    assert steps(np.array(stamps, dtype=np.int64)) == pytest.approx(np.array(live), nan_ok=True)
