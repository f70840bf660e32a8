"""What the driver thinks of its sensor: each thing that is wrong is seen, counted and said."""

from __future__ import annotations

import math

import pytest

from stateful_ahrs.errors import DeviceError
from stateful_ahrs.mpu9250.burst import Reading
from stateful_ahrs.mpu9250.monitor import Intervals, Level, Monitor
from stateful_ahrs.mpu9250.source import Faults, Sample

MS = 1_000_000  # ns


class Desk:
    """A source without anything behind it."""

    def __init__(self, rate: float | None = 100.0, has_magnetometer: bool = True) -> None:
        self.faults = Faults()
        self.rate = rate
        self.has_magnetometer = has_magnetometer

    def open(self) -> None: ...

    def read(self) -> list[Sample]:
        return []

    def close(self) -> None: ...

    def __str__(self) -> str:
        return "MPU-9250 on a desk"


def reading(n: int, **changed: object) -> Reading:
    """The ``n``-th of a live sensor."""
    noise = 1e-3 * (n * 7 % 11)
    values: dict[str, object] = {
        "gyro": (noise, 0.0, -noise),
        "accel": (0.0, noise, 9.81),
        "temperature": 25.0,
        "mag": (20e-6 + 1e-7 * noise, 0.0, -40e-6),
        "mag_overflow": False,
        "saturated": (),
        **changed,
    }
    return Reading(**values)  # type: ignore[arg-type]


def seen(desk: Desk, count: int = 100, missed: int = 0, **changed: object) -> Monitor:
    monitor = Monitor(desk)
    for n in range(count):
        monitor.see(reading(n, **changed), missed if n == 50 else 0, n * 10 * MS)
    return monitor


def test_a_live_sensor_is_well():
    level, sentence, values = seen(Desk()).verdict(1.0, None)
    assert (level, sentence) == (Level.OK, "MPU-9250 on a desk: 100 Hz.")
    assert values["imu_rate_hz"] == values["mag_rate_hz"] == 100.0


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"saturated": ("gyro x",)}, "100 samples saturated (gyro x): choose a larger range"),
        ({"mag": None, "mag_overflow": True}, "100 magnetometer samples overflowed: a magnet"),
        ({"mag": None}, "The magnetometer gives no samples"),
        ({"temperature": 126.0}, "A temperature of 126 °C is not plausible"),
        ({"temperature": -90.0}, "A temperature of -90 °C is not plausible"),
    ],
)
def test_what_is_wrong_with_the_readings_is_said(changed: dict[str, object], sentence: str):
    level, found, _ = seen(Desk(), **changed).verdict(1.0, None)
    assert level is Level.WARN
    assert sentence in found


def test_a_board_that_sends_no_temperature_is_well():
    level, _, values = seen(Desk(), temperature=math.nan).verdict(1.0, None)
    assert level is Level.OK
    assert math.isnan(values["temperature_c"])  # type: ignore[arg-type]


def test_a_chip_without_magnetometer_is_well_without():
    level, _, _ = seen(Desk(has_magnetometer=False), mag=None).verdict(1.0, None)
    assert level is Level.OK


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("bus_errors", "2 transactions failed"),
        ("bytes_discarded", "2 bytes were no samples"),
        ("fifo_overflows", "The FIFO overflowed 2 times"),
    ],
)
def test_what_went_wrong_on_the_wire_is_said_once(fault: str, sentence: str):
    desk = Desk()
    monitor = seen(desk)
    setattr(desk.faults, fault, 2)
    level, found, values = monitor.verdict(1.0, None)
    assert (level, values[fault]) == (Level.WARN, 2)
    assert sentence in found
    for n in range(100):
        monitor.see(reading(n + 100), 0, (n + 100) * 10 * MS)
    assert monitor.verdict(1.0, None)[0] is Level.OK


def test_the_piece_of_a_sample_that_a_stream_begins_with_is_counted_but_no_fault():
    desk = Desk()
    monitor = Monitor(desk)
    desk.faults.bytes_discarded = 34
    for n in range(100):
        monitor.see(reading(n), 0, n * 10 * MS)
    level, _, values = monitor.verdict(1.0, None)
    assert (level, values["bytes_discarded"]) == (Level.OK, 34)


def test_missed_samples_are_said_with_the_remedy():
    level, sentence, values = seen(Desk(), missed=3).verdict(1.0, None)
    assert (level, values["missed"]) == (Level.WARN, 3)
    assert sentence == "3 samples were lost before they were read. Set fifo to true."


def test_bytes_that_cost_samples_are_said_with_them():
    desk = Desk(rate=None)
    monitor = seen(desk, missed=3)
    desk.faults.bytes_discarded = 117
    sentence = monitor.verdict(1.0, None)[1]
    assert sentence == "117 bytes were no samples and were discarded. 3 samples are missing."


def test_one_is_not_called_several():
    desk = Desk()
    monitor = seen(desk, missed=1)
    sentence = monitor.verdict(1.0, None)[1]
    assert sentence == "1 sample was lost before it was read. Set fifo to true."
    desk.faults.bytes_discarded = 1
    seen_again = monitor.verdict(1.0, None)[1]
    assert seen_again == "1 byte was no sample and was discarded."


def test_missed_samples_of_a_board_have_no_such_remedy():
    assert "fifo" not in seen(Desk(rate=None), missed=3).verdict(1.0, None)[1]


@pytest.mark.parametrize(("count", "level"), [(0, Level.WARN), (80, Level.WARN), (95, Level.OK)])
def test_a_rate_too_low_is_said(count: int, level: Level):
    assert seen(Desk(), count).verdict(1.0, None)[0] is level


def test_at_a_low_rate_one_sample_more_or_less_is_no_matter():
    assert seen(Desk(rate=4.0), 3).verdict(1.0, None)[0] is Level.OK


def test_a_lost_device_is_an_error_with_its_reason():
    level, sentence, _ = seen(Desk()).verdict(1.0, DeviceError("gone."))
    assert (level, sentence) == (Level.ERROR, "gone.")


def test_frozen_counts_are_noticed_after_a_quarter_of_a_second():
    monitor = seen(Desk())
    with pytest.raises(DeviceError, match="the same counts again and again"):
        for n in range(100):
            monitor.see(reading(0), 0, (100 + n) * 10 * MS)
    assert 25 <= n <= 27
    assert monitor.counts.frozen == 1


def test_frozen_counts_at_a_high_rate_need_their_time_and_at_a_low_rate_their_number():
    for period, expected in ((1, 251), (250, 20)):
        monitor = Monitor(Desk())
        with pytest.raises(DeviceError):
            for n in range(1000):
                monitor.see(reading(0), 0, n * period * MS)
        assert n == expected


def test_what_is_frozen_stays_so_until_it_changes():
    monitor = Monitor(Desk())
    for n in range(26):
        monitor.see(reading(0), 0, n * 10 * MS)
    for n in range(3):
        with pytest.raises(DeviceError):
            monitor.see(reading(0), 0, (1000 + n) * MS)
    monitor.see(reading(1), 0, 2000 * MS)


def test_a_quiet_sensor_with_a_live_magnetometer_is_not_frozen():
    """Two decimals of a board at rest may be the same for long."""
    monitor = Monitor(Desk())
    for n in range(500):
        same = reading(0, mag=(1e-6 * (n % 5), 0.0, 0.0) if n % 3 == 0 else None)
        monitor.see(same, 0, n * 10 * MS)
    assert monitor.counts.frozen == 0


def test_even_stamps_have_no_jitter_and_uneven_ones_their_own():
    intervals = Intervals()
    for n in range(101):
        intervals.add(n * 10 * MS, 0)
    assert intervals.take() == (0.0, 0.0)
    for n in range(101, 201):
        intervals.add(n * 10 * MS + (n % 2) * MS, 0)
    rms, largest = intervals.take()
    assert rms == pytest.approx(1e-3, rel=0.02)  # 9 and 11 ms in turn
    assert largest == pytest.approx(1e-3, rel=0.02)


def test_a_step_over_a_missing_sample_is_no_jitter():
    intervals = Intervals()
    for n in (0, 1, 2, 5, 6):
        intervals.add(n * 10 * MS, 2 if n == 5 else 0)
    assert intervals.take() == (0.0, 0.0)
