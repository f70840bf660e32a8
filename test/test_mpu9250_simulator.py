"""The simulated registers behave as the data sheets say."""

from __future__ import annotations

import math
import statistics
import struct
import time
from dataclasses import replace
from itertools import pairwise

import pytest

from stateful_ahrs.errors import DeviceError
from stateful_ahrs.mpu9250 import registers as reg
from stateful_ahrs.mpu9250.chip import Mpu9250, Settings
from stateful_ahrs.mpu9250.motion import Motion, Turn, X, Z, motion
from stateful_ahrs.mpu9250.simulated_ak8963 import SimulatedAk8963
from stateful_ahrs.mpu9250.simulator import TRIMS, SimulatedMpu9250, Truth, VirtualClock
from stateful_ahrs.mpu9250.world import IDEAL, Earth, Errors
from stateful_ahrs.rotor import conjugate, rotate

MS = 1_000_000  # ns
REST = Motion()
NO_FUSES = (128, 128, 128)  # factor 1


def powered(clock: VirtualClock, **options: object) -> SimulatedMpu9250:
    """A chip at rest that has started up at 1 kHz, with its interrupt enabled."""
    sim = SimulatedMpu9250(REST, clock=clock, errors=IDEAL, **options)  # type: ignore[arg-type]
    sim.write(reg.ADDRESS, reg.CONFIG, b"\x02")
    sim.write(reg.ADDRESS, reg.INT_ENABLE, b"\x01")
    clock.sleep(0.05)
    return sim


def register(sim: SimulatedMpu9250, address: int) -> int:
    return sim.read(reg.ADDRESS, address, 1)[0]


def bypass(sim: SimulatedMpu9250) -> None:
    sim.write(reg.ADDRESS, reg.INT_PIN_CFG, b"\x02")


# --- MPU-9250 ------------------------------------------------------------------------------------


def test_reset_clears_every_setting_and_wakes() -> None:
    clock = VirtualClock()
    sim = powered(clock)
    sim.write(reg.ADDRESS, reg.GYRO_CONFIG, b"\x18\x18")
    sim.write(reg.ADDRESS, reg.PWR_MGMT_1, bytes((reg.SLEEP,)))
    sim.write(reg.ADDRESS, reg.PWR_MGMT_1, bytes((reg.H_RESET,)))
    clock.sleep(0.1)
    found = {n: value for n, value in enumerate(sim.read(reg.ADDRESS, 0, 0x80)) if value}
    trims = {reg.SELF_TEST_ACCEL + n: TRIMS[n] for n in range(3)}
    trims |= {reg.SELF_TEST_GYRO + n: TRIMS[3 + n] for n in range(3)}
    expected = {reg.PWR_MGMT_1: 0x01, reg.WHO_AM_I: 0x71}  # register map, section 3
    assert found == expected | trims  # of this chip


def test_a_chip_that_resets_does_not_answer() -> None:
    clock = VirtualClock()
    sim = powered(clock)
    sim.write(reg.ADDRESS, reg.PWR_MGMT_1, bytes((reg.H_RESET,)))
    clock.sleep(0.0999)
    with pytest.raises(DeviceError, match="no device answers at I2C address 0x68"):
        sim.read(reg.ADDRESS, reg.WHO_AM_I, 1)


@pytest.mark.parametrize("address", [0x69, 0x0C])
def test_nobody_answers_at_another_address(address: int) -> None:
    sim = powered(VirtualClock())
    with pytest.raises(DeviceError, match=f"0x{address:02X}"):
        sim.write(address, 0, b"\0")
    with pytest.raises(DeviceError, match=f"0x{address:02X}"):
        sim.read(address, 0, 1)


def test_data_and_identity_cannot_be_written() -> None:
    sim = powered(VirtualClock())
    sim.write(reg.ADDRESS, reg.WHO_AM_I, b"\x55")
    sim.write(reg.ADDRESS, reg.EXT_SENS_DATA_00, b"\x55")
    assert register(sim, reg.WHO_AM_I) == 0x71
    assert register(sim, reg.EXT_SENS_DATA_00) == 0


@pytest.mark.parametrize(("divider", "period"), [(0, 1.0), (4, 5.0), (255, 256.0)])
def test_samples_come_at_1_khz_by_one_plus_the_divider(divider: int, period: float) -> None:
    clock = VirtualClock()
    sim = powered(clock)
    sim.write(reg.ADDRESS, reg.SMPLRT_DIV, bytes((divider,)))
    stamps = []
    for _ in range(20 * (1 + divider)):
        clock.sleep(0.0005)
        if register(sim, reg.INT_STATUS) & reg.RAW_DATA_RDY:
            stamps.append(sim.truth.stamp)
    assert len(stamps) >= 10
    assert {b - a for a, b in pairwise(stamps)} == {period * MS}


def test_without_low_pass_the_divider_has_no_effect() -> None:
    clock = VirtualClock()
    sim = powered(clock)
    sim.write(reg.ADDRESS, reg.SMPLRT_DIV, b"\xff")
    sim.write(reg.ADDRESS, reg.CONFIG, b"\x00")
    before = sim.truth.stamp
    clock.sleep(0.000125)
    register(sim, reg.INT_STATUS)
    assert sim.truth.stamp == before + MS // 8


def test_asleep_it_keeps_the_last_sample_and_awake_it_needs_35_ms_for_the_next() -> None:
    clock = VirtualClock()
    sim = powered(clock)
    register(sim, reg.INT_STATUS)
    last = sim.truth.stamp
    sim.write(reg.ADDRESS, reg.PWR_MGMT_1, bytes((reg.SLEEP,)))
    clock.sleep(1.0)
    assert register(sim, reg.INT_STATUS) == 0
    assert sim.truth.stamp == last
    sim.write(reg.ADDRESS, reg.PWR_MGMT_1, b"\x01")
    sim.write(reg.ADDRESS, reg.SMPLRT_DIV, b"\x00")  # a setting shortens nothing
    clock.sleep(0.0349)
    assert register(sim, reg.INT_STATUS) == 0
    clock.sleep(0.0001)
    assert register(sim, reg.INT_STATUS) == reg.RAW_DATA_RDY


def test_data_ready_is_cleared_by_reading_the_status_and_by_nothing_else() -> None:
    clock = VirtualClock()
    sim = powered(clock)
    sim.read(reg.ADDRESS, reg.ACCEL_XOUT_H, 14)
    assert register(sim, reg.INT_STATUS) == reg.RAW_DATA_RDY
    assert register(sim, reg.INT_STATUS) == 0


def test_data_ready_needs_its_interrupt_enabled() -> None:
    clock = VirtualClock()
    sim = powered(clock)
    sim.write(reg.ADDRESS, reg.INT_ENABLE, b"\x00")
    register(sim, reg.INT_STATUS)
    clock.sleep(0.01)
    assert register(sim, reg.INT_STATUS) == 0


def test_a_sample_is_held_between_the_instants_of_sampling() -> None:
    clock = VirtualClock()
    spin = Motion(Turn(Z, 1000.0, -500.0, 1000.0))
    sim = SimulatedMpu9250(spin, clock=clock, seed=1)
    sim.write(reg.ADDRESS, reg.CONFIG, b"\x02")
    clock.sleep(0.1)
    first = sim.read(reg.ADDRESS, reg.ACCEL_XOUT_H, 14)
    clock.sleep(0.0009)
    assert sim.read(reg.ADDRESS, reg.ACCEL_XOUT_H, 14) == first
    clock.sleep(0.0001)
    assert sim.read(reg.ADDRESS, reg.ACCEL_XOUT_H, 14) != first


def test_the_low_pass_delays_by_the_register_map() -> None:
    """In a turn that speeds up, a rate that is late is a rate too low."""
    clock = VirtualClock()
    sim = SimulatedMpu9250(Motion(Turn(Z, 40.0, 0.0, 10.0)), clock=clock, errors=IDEAL)
    sim.write(reg.ADDRESS, reg.GYRO_CONFIG, b"\x08")
    sim.write(reg.ADDRESS, reg.CONFIG, b"\x06")
    clock.now = 2500 * MS
    (z,) = struct.unpack(">h", sim.read(reg.ADDRESS, reg.ACCEL_XOUT_H + 12, 2))
    t, late = sim.truth.stamp * 1e-9, 0.03348
    scale = math.radians(500.0) / 32768
    expected = 4.0 * (1.0 - math.cos(2.0 * math.pi * (t - late) / 10.0))
    assert z * scale == pytest.approx(expected, abs=0.51 * scale)  # half a count


@pytest.mark.parametrize(
    ("dlpf", "gyro", "accel"),
    [
        (2, 0.1, 8.0 * math.sqrt(99.0 / 94.0)),
        (5, 0.1 * math.sqrt(10.0 / 92.0), 8.0 * math.sqrt(10.2 / 94.0)),
    ],
)
def test_noise_is_that_of_the_data_sheet(dlpf: int, gyro: float, accel: float) -> None:
    clock = VirtualClock()
    chip = Mpu9250(
        SimulatedMpu9250(REST, clock=clock),
        Settings(1000.0, gyro_range=250, accel_range=2, dlpf=dlpf),
        sleep=clock.sleep,
    )
    readings = []
    for _ in range(3000):
        clock.sleep(0.001)
        reading = chip.read()
        assert reading is not None
        readings.append(reading)
    mags = [r.mag for r in readings if r.mag is not None]
    for axis in range(3):
        # 3000 draws give the deviation within 1.3 % rms, 300 within 4 %: four times that
        rate = statistics.stdev(math.degrees(r.gyro[axis]) for r in readings)
        assert rate == pytest.approx(gyro, rel=0.055)
        force = statistics.stdev(r.accel[axis] / 9.80665e-3 for r in readings)
        assert force == pytest.approx(accel, rel=0.055)
        field = statistics.stdev(m[axis] * 1e6 for m in mags)
        assert field == pytest.approx(0.6, rel=0.17)


def test_errors_shift_and_bend_what_is_measured() -> None:
    clock = VirtualClock()
    errors = replace(
        IDEAL,
        gyro_bias=(0.1, -0.2, 0.3),
        accel_offset=(0.5, -0.6, 0.7),
        hard_iron=(200e-6, -100e-6, 50e-6),
        soft_iron=((1.1, 0.05, 0.0), (0.05, 0.9, 0.0), (0.0, 0.0, 1.0)),
        temperature=-12.0,
    )
    sim = SimulatedMpu9250(REST, clock=clock, errors=errors, earth=Earth(9.81, 40e-6, 0.0))
    chip = Mpu9250(sim, Settings(100.0), sleep=clock.sleep)
    clock.sleep(0.02)
    reading = chip.read()
    assert reading is not None
    assert reading.gyro == pytest.approx((0.1, -0.2, 0.3), abs=3e-4)  # half a count, as below
    assert reading.accel == pytest.approx((0.5, -0.6, 10.51), abs=6e-4)
    assert reading.temperature == pytest.approx(-12.0, abs=2e-3)
    assert reading.mag == pytest.approx((244e-6, -98e-6, 50e-6), abs=0.1e-6)


def test_the_accelerometer_has_a_delay_of_its_own() -> None:
    clock = VirtualClock()
    turning = Motion(Turn(X, 500.0, -500.0, 1000.0))  # 1 rad/s
    sim = SimulatedMpu9250(turning, clock=clock, errors=IDEAL)
    sim.write(reg.ADDRESS, reg.ACCEL_CONFIG2, b"\x06")
    clock.sleep(1.0)
    counts = struct.unpack(">3h", sim.read(reg.ADDRESS, reg.ACCEL_XOUT_H, 6))
    then = turning.rotor(sim.truth.stamp * 1e-9 - 0.03248)
    expected = rotate(conjugate(then), (0.0, 0.0, 9.81))
    scale = 2.0 * 9.80665 / 32768
    assert [n * scale for n in counts] == pytest.approx(expected, abs=0.51 * scale)


def test_truth_is_that_of_the_last_sample_taken() -> None:
    clock = VirtualClock(now=5_000 * MS)  # the motion begins when the simulator does
    tumble = motion("tumble")
    sim = SimulatedMpu9250(tumble, clock=clock)
    assert sim.truth == Truth(5_000 * MS, tumble.rotor(0.0), tumble.rate(0.0))
    sim.write(reg.ADDRESS, reg.CONFIG, b"\x02")
    clock.sleep(3.0004)
    register(sim, reg.INT_STATUS)
    clock.sleep(0.5)  # nobody looks
    assert sim.truth == Truth(8_000 * MS, tumble.rotor(3.0), tumble.rate(3.0))


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others() -> None:
    def bursts(seed: int) -> list[bytes]:
        clock = VirtualClock()
        sim = SimulatedMpu9250(motion("tumble"), clock=clock, seed=seed)
        Mpu9250(sim, Settings(1000.0), sleep=clock.sleep)
        found = []
        for _ in range(100):
            clock.sleep(0.001)
            found.append(sim.read(reg.ADDRESS, reg.INT_STATUS, 23))
        return found

    assert bursts(7) == bursts(7)
    assert bursts(7) != bursts(8)


def test_a_sample_costs_less_than_a_tenth_of_its_time_at_1_khz() -> None:
    clock = VirtualClock()
    sim = SimulatedMpu9250(motion("tumble"), clock=clock)
    chip = Mpu9250(sim, Settings(1000.0), sleep=clock.sleep)
    costs = []
    for _ in range(10):  # the best of ten, for machines that do other things as well
        begin = time.thread_time()
        for _ in range(200):
            clock.sleep(0.001)
            chip.read()
        costs.append((time.thread_time() - begin) / 200)
    assert min(costs) < 100e-6


# --- the auxiliary master ------------------------------------------------------------------------


def slave(sim: SimulatedMpu9250, address: int, first: int, control: int) -> None:
    sim.write(reg.ADDRESS, reg.I2C_SLV0_ADDR, bytes((address, first, control)))


def test_the_auxiliary_master_fetches_what_slave_0_names() -> None:
    clock = VirtualClock()
    sim = powered(clock)
    slave(sim, 0x8C, reg.AK_WIA, 0x81)
    clock.sleep(0.01)
    assert register(sim, reg.EXT_SENS_DATA_00) == 0  # the master is off
    sim.write(reg.ADDRESS, reg.USER_CTRL, bytes((reg.I2C_MST_EN,)))
    clock.sleep(0.01)
    assert register(sim, reg.EXT_SENS_DATA_00) == reg.AK_DEVICE_ID


def test_a_slave_that_is_not_there_leaves_a_nack() -> None:
    clock = VirtualClock()
    sim = powered(clock)
    sim.write(reg.ADDRESS, reg.USER_CTRL, bytes((reg.I2C_MST_EN,)))
    slave(sim, 0x8D, 0, 0x81)
    clock.sleep(0.01)
    assert register(sim, reg.I2C_MST_STATUS) == reg.I2C_SLV0_NACK
    assert register(sim, reg.EXT_SENS_DATA_00) == 0


def test_a_measurement_that_a_late_reader_missed_is_gone() -> None:
    """The auxiliary master fetched it into a sample that nobody read."""
    clock = VirtualClock()
    sim = SimulatedMpu9250(REST, clock=clock)
    chip = Mpu9250(sim, Settings(1000.0), sleep=clock.sleep)
    fresh = 0
    for _ in range(100):
        clock.sleep(0.007)
        reading = chip.read()
        assert reading is not None
        fresh += reading.mag is not None
    assert fresh == 10  # one sample in ten has it, and 7 ms meet each of the ten alike


def test_the_magnetometer_is_on_the_bus_only_in_bypass() -> None:
    clock = VirtualClock()
    sim = powered(clock)
    bypass(sim)
    assert sim.read(reg.AK_ADDRESS, reg.AK_WIA, 1) == b"\x48"
    sim.write(reg.ADDRESS, reg.USER_CTRL, bytes((reg.I2C_MST_EN,)))
    with pytest.raises(DeviceError, match="0x0C"):
        sim.read(reg.AK_ADDRESS, reg.AK_WIA, 1)


def test_the_magnetometer_outlives_a_reset_of_the_chip() -> None:
    clock = VirtualClock()
    sim = powered(clock)
    bypass(sim)
    sim.write(reg.AK_ADDRESS, reg.AK_CNTL1, b"\x16")
    sim.write(reg.ADDRESS, reg.PWR_MGMT_1, bytes((reg.H_RESET,)))
    clock.sleep(0.2)
    bypass(sim)
    assert sim.read(reg.AK_ADDRESS, reg.AK_CNTL1, 1) == b"\x16"


def test_an_mpu_6500_has_no_magnetometer_even_in_bypass() -> None:
    sim = powered(VirtualClock(), who_am_i=0x70)
    bypass(sim)
    with pytest.raises(DeviceError, match="0x0C"):
        sim.read(reg.AK_ADDRESS, reg.AK_WIA, 1)


# --- AK8963 --------------------------------------------------------------------------------------


def magnetometer(
    field: tuple[float, float, float] = (30e-6, -20e-6, 10e-6),
    mode: int = 0x16,
    fuses: tuple[int, int, int] = NO_FUSES,
) -> SimulatedAk8963:
    """An AK8963 in a mode since time 0, in a constant field (sensor frame)."""
    mag = SimulatedAk8963(lambda now: field, fuses)
    mag.write(reg.AK_CNTL1, mode, 0)
    return mag


def axes(mag: SimulatedAk8963, now: int) -> tuple[int, ...]:
    return struct.unpack("<3h", mag.read(reg.AK_HXL, 7, now)[:6])


@pytest.mark.parametrize(
    ("field", "counts"),
    [
        ((15e-6, 0.0, 0.0), (0, 100, 0)),
        ((0.0, 15e-6, 0.0), (100, 0, 0)),
        ((0.0, 0.0, 15e-6), (0, 0, -100)),
    ],
)
def test_the_magnetometer_has_axes_of_its_own(
    field: tuple[float, float, float], counts: tuple[int, int, int]
) -> None:
    """Data sheet PS-MPU-9250A-01, section 9.1: its x is the chip's y, its z points down."""
    assert axes(magnetometer(field), 10 * MS) == counts


def test_14_bit_counts_are_four_times_as_coarse() -> None:
    assert axes(magnetometer((60e-6, 0.0, 0.0), mode=0x06), 10 * MS) == (0, 100, 0)


def test_counts_are_those_before_the_factory_adjustment() -> None:
    mag = magnetometer((150e-6, 150e-6, -150e-6), fuses=(0, 128, 255))
    assert axes(mag, 10 * MS) == (2000, 1000, 668)  # factors 0.5, 1, 1.496


@pytest.mark.parametrize(("mode", "period"), [(0x16, 10 * MS), (0x12, 125 * MS)])
def test_data_are_ready_once_in_each_period(mode: int, period: int) -> None:
    mag = magnetometer(mode=mode)
    fresh = [n for n in range(1000) if mag.read(reg.AK_ST1, 8, n * MS)[0] & reg.AK_DRDY]
    assert fresh == [n for n in range(1, 1000) if n * MS % period == 0]


def test_in_power_down_nothing_is_measured() -> None:
    assert magnetometer(mode=0x10).read(reg.AK_ST1, 8, 1000 * MS) == bytes(8)


def test_skipped_data_are_marked() -> None:
    mag = magnetometer()
    assert mag.read(reg.AK_ST1, 8, 10 * MS)[0] == reg.AK_DRDY
    assert mag.read(reg.AK_ST1, 8, 30 * MS)[0] == reg.AK_DRDY | reg.AK_DOR


def test_until_the_second_status_is_read_nothing_new_comes() -> None:
    mag = magnetometer()
    mag.read(reg.AK_HXL, 6, 10 * MS)
    assert mag.read(reg.AK_ST1, 1, 50 * MS) == b"\x00"
    mag.read(reg.AK_ST2, 1, 50 * MS)
    assert mag.read(reg.AK_ST1, 1, 60 * MS)[0] & reg.AK_DRDY


@pytest.mark.parametrize(("strength", "overflow"), [(1637e-6, 0), (1638e-6, reg.AK_HOFL)])
def test_a_field_too_strong_in_sum_overflows(strength: float, overflow: int) -> None:
    mag = magnetometer((strength, -strength, strength))  # 4911 and 4914 µT
    assert mag.read(reg.AK_ST2, 1, 10 * MS)[0] == overflow | reg.AK_16_BIT


def test_the_fuses_can_be_read_in_their_mode_alone() -> None:
    mag = magnetometer(mode=reg.AK_FUSE_ROM, fuses=(1, 2, 3))
    assert mag.read(reg.AK_ASAX, 3, 0) == bytes((1, 2, 3))
    mag.write(reg.AK_CNTL1, reg.AK_POWER_DOWN, 0)
    assert mag.read(reg.AK_ASAX, 3, 0) == bytes(3)


def test_the_way_between_modes_is_power_down_for_100_us() -> None:
    mag = magnetometer(mode=reg.AK_FUSE_ROM)
    mag.write(reg.AK_CNTL1, 0x16, MS)
    assert mag.read(reg.AK_CNTL1, 1, MS)[0] == reg.AK_FUSE_ROM
    mag.write(reg.AK_CNTL1, reg.AK_POWER_DOWN, MS)
    mag.write(reg.AK_CNTL1, 0x16, MS + 99_999)
    assert mag.read(reg.AK_CNTL1, 1, MS)[0] == reg.AK_POWER_DOWN
    mag.write(reg.AK_CNTL1, 0x16, MS + 100_000)
    assert mag.read(reg.AK_CNTL1, 1, MS)[0] == 0x16


def test_soft_reset_is_power_down() -> None:
    mag = magnetometer()
    mag.write(reg.AK_CNTL2, reg.AK_SOFT_RESET, 5 * MS)
    assert mag.read(reg.AK_ST1, 9, 100 * MS) == bytes(9)
    mag.write(reg.AK_CNTL2, reg.AK_SOFT_RESET, 100 * MS)
    mag.write(reg.AK_CNTL1, 0x16, 100 * MS + 99_999)
    assert mag.read(reg.AK_CNTL1, 1, 101 * MS)[0] == reg.AK_POWER_DOWN


def test_the_default_errors_leave_a_demonstration_within_its_bound() -> None:
    """Offsets of a calibrated chip: heading and tilt from them stay below 1°."""
    errors = Errors()
    assert math.hypot(*errors.hard_iron) / 25e-6 < math.radians(1.0)  # of the horizontal field
    assert math.hypot(*errors.gyro_bias) < math.radians(0.2)
    assert math.hypot(*errors.accel_offset) / 9.81 < math.radians(0.5)
