"""Stamps from a device's clock: near the truth, strictly in order, whatever the clocks do."""

from __future__ import annotations

import random
from collections.abc import Iterator
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stateful_ahrs.mpu9250.device_clock import DeviceClock, HostClock
from stateful_ahrs.mpu9250.simulator import VirtualClock

MS = 1_000_000  # ns
START = 5_000_000 * MS  # of the host's steady clock


def samples(
    seconds: float,
    drift: float = 0.0,
    rate: float = 100.0,
    start: int = START,
    device: int = 0,
    delay: float = 0.2,
    seed: int = 0,
) -> Iterator[tuple[int, int, int]]:
    """When each sample was taken, the device's clock then, and when it came; ns.

    The host's clock runs faster by ``drift``. A delay has a least of ``delay`` ms, and more: 1 ms
    in the mean, and 30 ms for a moment now and then.
    """
    more = random.Random(seed)
    came = 0
    for n in range(int(seconds * rate)):
        ticks = round(n * 1e9 / rate)
        taken = start + round(ticks * (1.0 + drift))
        late = delay + more.expovariate(1.0) + (30.0 if more.random() < 0.01 else 0.0)
        came = max(came, taken + round(late * MS))  # in order, over one line
        yield taken, device + ticks, came


@pytest.mark.parametrize("drift", [0.0, 50e-6, -50e-6, 5e-3, -5e-3, 0.02, -0.02])
@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_stamps_are_near_the_truth_though_what_comes_is_late(drift: float, rate: float):
    clock = DeviceClock()
    errors = []
    for taken, ticks, came in samples(30.0, drift, rate):
        errors.append(clock.stamp(ticks, came) - taken)
    settled = errors[int(3 * rate) :]
    # the least delay, 0.2 ms, stays; of a span of 25 delays the least is 0.04 ms more in the mean
    assert max(settled) < 0.6 * MS
    assert min(settled) > -0.3 * MS
    assert clock.drift == pytest.approx(drift, abs=1e-4)


@given(st.floats(-0.01, 0.01), st.integers(0, 10**6))
def test_steps_between_stamps_are_the_device_s_within_10_percent(drift: float, seed: int):
    clock = DeviceClock()
    stamps = [clock.stamp(ticks, came) for _, ticks, came in samples(5.0, drift, seed=seed)]
    steps = [b - a for a, b in pairwise(stamps)]
    assert min(steps) >= 0.9 * 10 * MS
    assert max(steps) <= 1.1 * 10 * MS


def test_settled_stamps_are_far_more_even_than_arrivals():
    clock = DeviceClock()
    found = [(clock.stamp(ticks, came), came) for _, ticks, came in samples(30.0, 30e-6)][500:]

    def jitter(stamps: list[int]) -> float:
        steps = [b - a for a, b in pairwise(stamps)]
        mean = sum(steps) / len(steps)
        return (sum((step - mean) ** 2 for step in steps) / len(steps)) ** 0.5

    assert jitter([stamp for stamp, _ in found]) < 0.02 * jitter([came for _, came in found])


@given(st.lists(st.tuples(st.integers(0, 1 << 45), st.integers(0, 50 * MS)), max_size=60))
def test_stamps_are_strictly_in_order_whatever_the_device_says(steps: list[tuple[int, int]]):
    clock = DeviceClock()
    host = START
    stamps = []
    for device, pause in steps:
        host += pause
        stamps.append(clock.stamp(device, host))
    assert all(a < b for a, b in pairwise(stamps))


@pytest.mark.parametrize("device", [0, 10_000_000 * MS])
def test_a_device_that_starts_anew_goes_on_at_the_host_s_time(device: int):
    clock = DeviceClock()
    for _, ticks, came in samples(10.0, 40e-6, device=7_000 * MS):
        last = clock.stamp(ticks, came)
    errors = []
    resumed = came + 700 * MS
    for taken, ticks, came in samples(5.0, 40e-6, start=resumed, device=device):
        stamp = clock.stamp(ticks, came)
        assert stamp > last
        last = stamp
        errors.append(stamp - taken)
    assert clock.restarts == 1
    assert max(map(abs, errors)) < 40 * MS  # from the first on: as late as it came, not later
    assert max(map(abs, errors[200:])) < 1 * MS


def test_a_host_that_slept_takes_what_had_waited_for_what_it_is():
    """Samples wait in the port while the process stands still; their own clock goes on."""
    clock = DeviceClock()
    errors = []
    for n, (taken, ticks, came) in enumerate(samples(10.0)):
        if 600 <= n < 750:
            came = max(came, START + 7_500 * MS)
        errors.append(clock.stamp(ticks, came) - taken)
    assert clock.restarts == 0
    assert max(map(abs, errors[300:])) < 1 * MS


def test_a_first_sample_that_came_late_spoils_nothing_for_long():
    clock = DeviceClock()
    errors = []
    for n, (taken, ticks, came) in enumerate(samples(10.0)):
        errors.append(clock.stamp(ticks, came + (80 * MS if n == 0 else 0)) - taken)
    assert max(map(abs, errors[200:])) < 1 * MS


def test_a_device_clock_that_nearly_stands_still_is_left_again_and_again():
    clock = DeviceClock()
    for _, ticks, came in samples(5.0):
        clock.stamp(ticks, came)
    for n in range(300):
        came += 10 * MS
        stamp = clock.stamp(ticks + n, came)
    assert clock.restarts >= 1
    assert came - stamp < 1_600 * MS  # late for half a second, and that for a second


# --- the host's own clocks -----------------------------------------------------------------------


class Clocks:
    """A host's clocks: the steady one, and the time, which can be set."""

    def __init__(self) -> None:
        self.steady = VirtualClock(START)
        self.ahead = 1_700_000_000_000 * MS

    def time(self) -> int:
        return self.steady.now + self.ahead


def test_the_time_is_that_of_the_host():
    clocks = Clocks()
    clock = HostClock(clocks.time, clocks.steady)
    clocks.steady.sleep(3.0)
    assert clock.time(clocks.steady.now) == clocks.time()


def test_equal_and_swapped_times_are_put_in_order():
    clocks = Clocks()
    clock = HostClock(clocks.time, clocks.steady)
    stamps = [clock.time(START + n * MS) for n in (5, 5, 4, 6)]
    assert all(a < b for a, b in pairwise(stamps))
    assert max(stamps) - min(stamps) <= MS


@pytest.mark.parametrize("step", [3_600_000 * MS, -3_600_000 * MS])
def test_a_host_whose_time_is_set_is_followed_and_that_is_counted(step: int):
    clocks = Clocks()
    clock = HostClock(clocks.time, clocks.steady)
    clock.time(clocks.steady.now)
    clocks.ahead += step
    clocks.steady.sleep(1.1)
    assert clock.time(clocks.steady.now) == clocks.time()
    assert clock.steps == 1


def test_a_time_that_is_slewed_is_followed_without_being_counted():
    clocks = Clocks()
    clock = HostClock(clocks.time, clocks.steady)
    for _ in range(60):
        clocks.ahead += MS // 2
        clocks.steady.sleep(1.1)
        assert clock.time(clocks.steady.now) == clocks.time()
    assert clock.steps == 0
