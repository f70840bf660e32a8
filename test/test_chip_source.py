"""Every sample of the chip once, with its time, from its registers or its FIFO; in virtual time."""

from __future__ import annotations

import random
import struct
from dataclasses import replace
from itertools import pairwise

import pytest
from faulty import FaultyBus

from stateful_ahrs.errors import DeviceError, UsageError
from stateful_ahrs.mpu9250 import registers as reg
from stateful_ahrs.mpu9250.bus import BusError
from stateful_ahrs.mpu9250.chip import Settings
from stateful_ahrs.mpu9250.chip_source import ChipSource
from stateful_ahrs.mpu9250.motion import motion
from stateful_ahrs.mpu9250.simulator import SimulatedMpu9250, VirtualClock
from stateful_ahrs.mpu9250.source import Sample
from stateful_ahrs.mpu9250.world import IDEAL

MS = 1_000_000  # ns
US = 1_000  # ns
COUNTS = struct.Struct(">7h")


class Wired(FaultyBus):
    """A bus on which a transaction takes its time: 400 kHz, nine bits a byte."""

    def read(self, address: int, register: int, count: int) -> bytes:
        data = super().read(address, register, count)
        self.sleep((3 + count) * 9 / 400e3)
        return data


class Bench:
    """A source on a simulated chip that keeps a log of its samples."""

    def __init__(self, settings: Settings, wired: bool = False, **options: object) -> None:
        self.clock = VirtualClock(7_000 * MS)
        self.log: list[tuple[int, bytes]] = []
        self.sim = SimulatedMpu9250(
            motion("tumble"),
            clock=self.clock,
            log=lambda stamp, data: self.log.append((stamp, data)),
            **options,  # type: ignore[arg-type]
        )
        self.bus = (Wired if wired else FaultyBus)(self.sim, self.clock.sleep)
        self.settings = settings
        self.source = ChipSource(
            lambda: self.bus, settings, sleep=self.clock.sleep, steady=self.clock
        )
        self.source.open()

    def read(self, count: int) -> list[Sample]:
        samples: list[Sample] = []
        while len(samples) < count:
            samples += self.source.read()
        return samples

    def counts(self, sample: Sample) -> tuple[int, ...]:
        """The six axes as the chip has them."""
        s, r = self.settings, sample.reading
        a, g = 32768 / (s.accel_range * 9.80665), 32768 / (s.gyro_range * 0.017453292519943295)
        return tuple(round(n * a) for n in r.accel) + tuple(round(n * g) for n in r.gyro)

    def logged(self) -> list[tuple[int, ...]]:
        """The six axes of each sample that the chip took."""
        rows = [COUNTS.unpack(data) for _, data in self.log]
        return [row[:3] + row[4:] for row in rows]


RATES = pytest.mark.parametrize("rate", [1000.0, 200.0, 50.0, 4.0])
BOTH = pytest.mark.parametrize("fifo", [False, True], ids=["poll", "fifo"])


@BOTH
@RATES
def test_each_sample_comes_once_whole_and_in_order(rate: float, fifo: bool):
    bench = Bench(Settings(rate, fifo=fifo))
    samples = bench.read(200)
    found = [bench.counts(sample) for sample in samples]
    logged = bench.logged()
    begin = logged.index(found[0])
    assert found == logged[begin : begin + len(found)]
    assert sum(sample.missed for sample in samples) == 0


@RATES
def test_the_time_of_a_polled_sample_is_right_to_a_fiftieth_of_the_period(rate: float):
    bench = Bench(Settings(rate))
    bench.read(2)
    for _ in range(200):
        (sample,) = bench.source.read()
        late = sample.arrival - bench.sim.truth.stamp
        assert 0 <= late <= 0.021 * 1e9 / rate


def test_the_clock_of_the_fifo_counts_samples():
    bench = Bench(Settings(1000.0, fifo=True))
    samples = bench.read(500)
    assert [b.device - a.device for a, b in pairwise(samples)] == [MS] * (len(samples) - 1)
    newest = [a for a, b in pairwise(samples) if a.arrival != b.arrival]
    late = [sample.arrival - (sample.device or 0) for sample in newest[5:]]
    assert max(late) - min(late) < MS  # no sample is older than a period when it is the newest


def test_a_late_reader_counts_what_it_missed():
    bench = Bench(Settings(200.0))
    bench.read(10)
    bench.clock.sleep(0.0531)  # ten whole periods and a half
    samples = bench.read(10)
    assert [sample.missed for sample in samples] == [9] + [0] * 9
    found = [bench.counts(sample) for sample in samples]
    assert bench.logged()[-10:] == found


def test_a_sample_that_was_read_late_has_the_time_at_which_it_was_taken():
    bench = Bench(Settings(100.0))
    bench.read(10)
    bench.clock.sleep(0.0173)
    (sample,) = bench.source.read()
    assert bench.clock.now - bench.sim.truth.stamp > 5 * MS
    assert abs(sample.arrival - bench.sim.truth.stamp) < 0.3 * MS
    assert sample.missed == 0


@pytest.mark.parametrize("rate", [1000.0, 200.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_reader_that_is_interrupted_anywhere_counts_and_stamps_right(rate: float, seed: int):
    bench = Bench(Settings(rate))
    bench.read(20)
    chance, period = random.Random(seed), 1e9 / rate

    class Interrupted:
        """A clock on which every sleep may take up to three periods longer."""

        def sleep(self, seconds: float) -> None:
            more = 3.0 * chance.random() if chance.random() < 0.1 else 0.0
            bench.clock.sleep(seconds + more * period * 1e-9)

    bench.source._sleep = Interrupted().sleep
    samples, errors = [], []
    for _ in range(1000):
        (sample,) = bench.source.read()
        samples.append(sample)
        errors.append(sample.arrival - bench.sim.truth.stamp)
    first = samples[0].arrival - errors[0]
    total = round((bench.sim.truth.stamp - first) / period)
    missed = total - (len(samples) - 1)
    # a read in the very moment of sampling may be taken for one before it, or after it
    assert sum(sample.missed for sample in samples[1:]) == pytest.approx(missed, rel=0.02)
    assert sum(abs(error) > 0.03 * period for error in errors) < 0.1 * len(errors)


def test_a_reader_that_is_always_late_misses_none_as_long_as_it_is_faster_than_the_chip():
    bench = Bench(Settings(200.0))
    samples = bench.read(3)
    for n in range(300):
        bench.clock.sleep(0.0005 + 0.004 * (n * 7 % 11) / 11)
        samples += bench.source.read()
    assert sum(sample.missed for sample in samples) == 0
    found = [bench.counts(sample) for sample in samples]
    logged = bench.logged()
    begin = logged.index(found[0])
    assert found == logged[begin : begin + len(found)]


@pytest.mark.parametrize("rate", [500.0, 200.0])
def test_on_a_real_wire_a_poll_loses_nothing(rate: float):
    bench = Bench(Settings(rate), wired=True)
    samples = bench.read(500)
    assert sum(sample.missed for sample in samples) == 0
    assert len({sample.arrival for sample in samples}) == len(samples)


def test_on_a_real_wire_the_fifo_holds_1_khz():
    bench = Bench(Settings(1000.0, fifo=True), wired=True)
    samples = bench.read(2000)
    found = [bench.counts(sample) for sample in samples]
    logged = bench.logged()
    begin = logged.index(found[0])
    assert found == logged[begin : begin + len(found)]
    assert bench.source.faults.fifo_overflows == 0


def test_fifo_holds_the_magnetometer_too():
    bench = Bench(Settings(1000.0, fifo=True))
    fresh = [sample.reading.mag is not None for sample in bench.read(1000)]
    assert sum(fresh) == pytest.approx(100, abs=2)


def test_fifo_without_magnetometer_holds_six_axes():
    bench = Bench(Settings(1000.0, fifo=True), who_am_i=0x70)
    samples = bench.read(100)
    assert all(sample.reading.mag is None for sample in samples)
    found = [bench.counts(sample) for sample in samples]
    begin = bench.logged().index(found[0])
    assert found == bench.logged()[begin : begin + len(found)]


@pytest.mark.parametrize("pause", [0.03, 0.1, 0.5])
def test_a_fifo_that_overflowed_is_emptied_and_what_it_lost_is_counted(pause: float):
    bench = Bench(Settings(1000.0, fifo=True))
    before = bench.read(100)
    bench.clock.sleep(pause)
    after = bench.read(100)
    assert bench.source.faults.fifo_overflows == 1
    found = [bench.counts(sample) for sample in before + after]
    logged = bench.logged()
    lost = logged.index(found[len(before)]) - logged.index(found[len(before) - 1]) - 1
    assert after[0].missed == pytest.approx(lost, abs=1)
    assert [sample.missed for sample in after[1:]] == [0] * (len(after) - 1)
    begin = logged.index(found[len(before)])
    assert found[len(before) :] == logged[begin : begin + len(after)]
    elapsed = (after[0].device or 0) - (before[-1].device or 0)
    assert elapsed == pytest.approx((lost + 1) * MS, abs=MS)


def test_overflow_after_overflow_is_counted_once_each():
    bench = Bench(Settings(1000.0, fifo=True))
    before = bench.read(100)
    bench.bus.latency = 0.02
    for _ in range(5):
        assert bench.source.read() == []
    bench.bus.latency = 0.0
    after = bench.read(100)
    assert bench.source.faults.fifo_overflows >= 5
    logged = bench.logged()
    last, first = (logged.index(bench.counts(sample)) for sample in (before[-1], after[0]))
    lost = (bench.log[first][0] - bench.log[last][0]) // MS - 1
    assert after[0].missed == pytest.approx(lost, abs=5)
    assert lost > 400


def test_a_full_fifo_is_not_an_overflow():
    bench = Bench(Settings(1000.0, fifo=True))
    bench.read(10)
    bench.clock.sleep(0.0225)  # 23 samples of 22 bytes fit into 512
    bench.read(100)
    assert bench.source.faults.fifo_overflows == 0


def test_bypass_reads_the_magnetometer_on_the_bus():
    bench = Bench(Settings(200.0, bypass=True))
    auxiliary = Bench(Settings(200.0))
    samples = bench.read(400)
    assert sum(sample.reading.mag is not None for sample in samples) == pytest.approx(200, abs=2)
    assert bench.sim.read(reg.ADDRESS, reg.USER_CTRL, 1) == b"\0"
    others = [s.reading.mag for s in auxiliary.read(400) if s.reading.mag is not None]
    found = [s.reading.mag for s in samples if s.reading.mag is not None]
    assert found[-1] == pytest.approx(others[-1], abs=5e-6)  # the same motion, some ms apart


def test_fifo_and_bypass_exclude_each_other():
    with pytest.raises(UsageError, match="fifo and bypass exclude each other"):
        Settings(fifo=True, bypass=True)


@BOTH
@pytest.mark.parametrize("nacks", [1, 2])
def test_a_transaction_that_fails_is_tried_again_and_counted(fifo: bool, nacks: int):
    bench = Bench(Settings(200.0, fifo=fifo))
    bench.read(10)
    bench.bus.nacks = nacks
    samples = bench.read(50)
    assert bench.source.faults.bus_errors == nacks
    assert sum(sample.missed for sample in samples) == 0


@pytest.mark.parametrize("register", [reg.FIFO_R_W, reg.INT_STATUS, reg.USER_CTRL])
def test_a_fifo_left_in_the_midst_is_emptied_and_what_it_held_is_counted(register: int):
    """Nobody knows how many bytes a transaction that failed took out of it."""
    bench = Bench(Settings(1000.0, fifo=True))
    before = bench.read(50)
    if register == reg.USER_CTRL:
        bench.clock.sleep(0.1)  # it overflows, and then cannot be emptied at once
    bench.bus.refused = register
    after = bench.read(50)
    assert bench.source.faults.bus_errors == 1
    logged = bench.logged()
    last, first = (logged.index(bench.counts(sample)) for sample in (before[-1], after[0]))
    lost = (bench.log[first][0] - bench.log[last][0]) // MS - 1
    assert lost >= 4
    assert after[0].missed == pytest.approx(lost, abs=1)
    found = [bench.counts(sample) for sample in after]
    assert found == logged[first : first + len(after)]


def test_an_error_while_the_configuration_is_checked_costs_no_sample():
    bench = Bench(Settings(200.0))
    samples = bench.read(10)
    bench.bus.refused = reg.SMPLRT_DIV
    samples = bench.read(400)
    assert bench.source.faults.bus_errors == 1
    assert sum(sample.missed for sample in samples) == 0
    found = [bench.counts(sample) for sample in samples]
    begin = bench.logged().index(found[0])
    assert found == bench.logged()[begin : begin + len(found)]


@BOTH
def test_a_chip_that_was_unplugged_is_lost_and_comes_back_configured(fifo: bool):
    bench = Bench(Settings(200.0, fifo=fifo))
    bench.read(10)
    bench.bus.unplugged = True
    with pytest.raises(DeviceError, match="no device answers"):
        bench.read(10)
    bench.source.close()
    with pytest.raises(DeviceError, match="no device answers"):
        bench.source.open()
    assert bench.bus.closed == 2
    bench.bus.unplugged = False
    bench.sim.power_cycle()
    bench.clock.sleep(0.2)
    bench.source.open()
    samples = bench.read(20)
    assert any(sample.reading.mag is not None for sample in samples)
    assert samples[-1].reading.accel[2] == pytest.approx(9.81, abs=0.5)


@BOTH
def test_a_stuck_bus_is_noticed_and_gives_no_sample(fifo: bool):
    bench = Bench(Settings(200.0, fifo=fifo))
    bench.read(10)
    bench.bus.stuck = True
    with pytest.raises(BusError, match="every byte reads as 0xFF"):
        bench.read(10)


@BOTH
@pytest.mark.parametrize("rate", [1000.0, 4.0])
def test_a_chip_that_stops_sampling_is_lost_soon(rate: float, fifo: bool):
    bench = Bench(Settings(rate, fifo=fifo))
    bench.read(3)
    bench.sim.write(reg.ADDRESS, reg.PWR_MGMT_1, bytes((reg.SLEEP,)))
    begin = bench.clock.now
    with pytest.raises(DeviceError, match="answers, but has taken no sample for"):
        bench.read(100)
    assert (bench.clock.now - begin) * 1e-9 < 0.3 + 4.0 / rate


@pytest.mark.parametrize("register", [reg.CONFIG, reg.GYRO_CONFIG, reg.ACCEL_CONFIG])
def test_a_chip_that_lost_its_configuration_is_noticed_within_a_second(register: int):
    """It may go on sampling, as if nothing had happened, in other ranges."""
    bench = Bench(Settings(200.0))
    bench.read(10)
    bench.sim.write(reg.ADDRESS, register, b"\x00")
    with pytest.raises(DeviceError, match=f"lost its configuration: register 0x{register:02X}"):
        bench.read(250)


@BOTH
def test_a_supply_that_drops_for_a_moment_is_noticed(fifo: bool):
    bench = Bench(Settings(200.0, fifo=fifo))
    bench.read(10)
    bench.sim.power_cycle()
    with pytest.raises(DeviceError):
        bench.read(50)
    bench.clock.sleep(0.2)
    bench.source.open()
    assert any(sample.reading.mag is not None for sample in bench.read(20))


def test_a_magnetometer_that_falls_silent_is_started_anew_ever_less_often():
    bench = Bench(Settings(100.0))
    bench.read(50)

    def silence() -> None:
        bench.sim.write(reg.ADDRESS, reg.I2C_SLV0_CTRL, b"\0")

    silence()
    assert any(sample.reading.mag is not None for sample in bench.read(400)[300:])
    assert bench.source.faults.mag_restarts == 1
    silence()
    bench.read(320)
    assert bench.source.faults.mag_restarts == 1  # now it waits four seconds
    bench.read(200)
    assert bench.source.faults.mag_restarts == 2


@BOTH
def test_a_magnetometer_that_dies_takes_no_other_axis_with_it_and_may_come_back(fifo: bool):
    bench = Bench(Settings(100.0, fifo=fifo))
    bench.read(50)
    bench.sim.mag_gone = True
    samples = bench.read(500)
    assert all(sample.reading.mag is None for sample in samples[5:])
    # What each try to wake it costs is counted: of the time that has passed no sample is missing.
    passed = (samples[-1].arrival - samples[0].arrival) * 1e-9 * 100.0
    assert len(samples) + sum(sample.missed for sample in samples[1:]) == pytest.approx(
        passed, abs=4
    )
    assert sum(sample.missed for sample in samples) > 0
    assert bench.source.has_magnetometer  # it is missed
    bench.sim.mag_gone = False
    assert any(sample.reading.mag is not None for sample in bench.read(900))


@pytest.mark.parametrize("bypass", [False, True])
def test_a_chip_that_comes_back_without_its_magnetometer_gives_the_other_axes(bypass: bool):
    bench = Bench(Settings(100.0, bypass=bypass))
    bench.read(50)
    bench.sim.mag_gone = True
    bench.source.close()
    bench.source.open()
    assert all(sample.reading.mag is None for sample in bench.read(50))
    bench.sim.mag_gone = False
    assert any(sample.reading.mag is not None for sample in bench.read(400))


@pytest.mark.parametrize("bypass", [False, True])
def test_a_chip_that_never_had_its_magnetometer_is_refused(bypass: bool):
    clock = VirtualClock()
    sim = SimulatedMpu9250(motion("rest"), clock=clock)
    sim.mag_gone = True
    source = ChipSource(lambda: sim, Settings(bypass=bypass), sleep=clock.sleep, steady=clock)
    with pytest.raises(DeviceError):
        source.open()


def test_an_overflowing_magnetometer_is_not_silent():
    bench = Bench(Settings(100.0), errors=replace(IDEAL, hard_iron=(4900e-6, 0.0, 0.0)))
    bench.read(500)
    assert bench.source.faults.mag_restarts == 0


def test_an_mpu_6500_has_no_magnetometer_that_could_fall_silent():
    bench = Bench(Settings(100.0), who_am_i=0x70)
    bench.read(500)
    assert bench.source.faults.mag_restarts == 0
    assert not bench.source.has_magnetometer
    assert str(bench.source) == "MPU-6500 at 0x68 (no magnetometer)"


def test_the_bus_is_closed_if_the_chip_cannot_be_used():
    clock = VirtualClock()
    bus = FaultyBus(SimulatedMpu9250(motion("rest"), clock=clock, who_am_i=0x12), clock.sleep)
    source = ChipSource(lambda: bus, sleep=clock.sleep, steady=clock)
    with pytest.raises(DeviceError, match=r"0x12 .ICM-20602"):
        source.open()
    assert bus.closed == 1


def test_a_slow_bus_costs_samples_and_says_so():
    bench = Bench(Settings(1000.0))
    bench.bus.latency = 0.003
    samples = bench.read(100)
    assert sum(sample.missed for sample in samples) > 150
