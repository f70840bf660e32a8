"""The driver of the chip against the simulated registers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import pytest

from stateful_ahrs.errors import DeviceError, UsageError
from stateful_ahrs.mpu9250 import registers as reg
from stateful_ahrs.mpu9250.burst import Burst, Reading
from stateful_ahrs.mpu9250.bus import Bus
from stateful_ahrs.mpu9250.chip import ACCEL_RANGES, GYRO_RANGES, Mpu9250, Settings
from stateful_ahrs.mpu9250.motion import Motion, Turn, X, Y, Z, motion
from stateful_ahrs.mpu9250.simulator import SimulatedMpu9250, VirtualClock
from stateful_ahrs.mpu9250.world import IDEAL, Earth, Errors
from stateful_ahrs.rotor import Rotor, Vector, conjugate, rotate

REST = Motion()
UNIT = (2.0 / 7.0, -3.0 / 7.0, 6.0 / 7.0)
MAG_COUNT = 0.15e-6 * 1.2  # tesla; the factors of the simulator's default fuses are below 1.2


class Wire:
    """A bus that keeps the transactions and may falsify what is read."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.reads: list[tuple[int, int]] = []
        self.writes: list[tuple[int, ...]] = []
        self.falsify: Callable[[int, bytes], bytes] = lambda register, data: data

    def write(self, address: int, register: int, data: bytes) -> None:
        self.writes.append((register, *data))
        self.bus.write(address, register, data)

    def read(self, address: int, register: int, count: int) -> bytes:
        self.reads.append((register, count))
        return self.falsify(register, self.bus.read(address, register, count))

    def close(self) -> None:
        self.bus.close()


class Bench:
    """A chip on a simulated bus, in virtual time."""

    def __init__(
        self, moving: Motion = REST, settings: Settings | None = None, **options: object
    ) -> None:
        self.clock = VirtualClock()
        options = {"errors": IDEAL, **options}
        self.sim = SimulatedMpu9250(moving, clock=self.clock, **options)  # type: ignore[arg-type]
        self.wire = Wire(self.sim)
        self.settings = settings or Settings()

    def start(self) -> Mpu9250:
        self.chip = Mpu9250(self.wire, self.settings, sleep=self.clock.sleep)
        return self.chip

    def next(self) -> Reading:
        """The next sample, waited for."""
        for _ in range(5000):
            reading = self.chip.read()
            if reading is not None:
                return reading
            self.clock.sleep(1e-4)
        raise AssertionError("no sample in half a second")

    def first(self) -> Reading:
        """The first sample of a chip just started."""
        self.start()
        return self.next()

    def register(self, address: int) -> int:
        return self.sim.read(reg.ADDRESS, address, 1)[0]


def spinning(axis: Vector, rate: float) -> Motion:
    """A turn whose rate (rad/s) is at its maximum, and so constant, for the first seconds."""
    return Motion(Turn(axis, 500.0 * rate, -500.0, 1000.0))


def held(axis: Vector, angle: float) -> Motion:
    """At rest in this attitude."""
    return Motion(Turn(axis, angle, -2.0, 1.0))


def gravity(q: Rotor) -> Vector:
    return rotate(conjugate(q), (0.0, 0.0, 9.81))


def north(q: Rotor) -> Vector:
    return rotate(conjugate(q), (25e-6, 0.0, -50e-6 * math.sqrt(0.75)))


# --- configuration -------------------------------------------------------------------------------


@pytest.mark.parametrize("dlpf", [1, 6])
@pytest.mark.parametrize("k", range(4))
def test_every_setting_reaches_its_register(k: int, dlpf: int) -> None:
    bench = Bench(settings=Settings(50.0, GYRO_RANGES[k], ACCEL_RANGES[3 - k], dlpf))
    bench.sim.write(reg.ADDRESS, 0x23, b"\xff")  # what another program left: FIFO_EN
    bench.sim.write(reg.ADDRESS, reg.PWR_MGMT_1, bytes((reg.SLEEP,)))
    bench.start()
    found = bench.sim.read(reg.ADDRESS, reg.SMPLRT_DIV, 0x3A - reg.SMPLRT_DIV)
    assert {n: value for n, value in enumerate(found, reg.SMPLRT_DIV) if value} == {
        key: value
        for key, value in {
            reg.SMPLRT_DIV: 19,
            reg.CONFIG: dlpf,
            reg.GYRO_CONFIG: k << 3,
            reg.ACCEL_CONFIG: (3 - k) << 3,
            reg.ACCEL_CONFIG2: dlpf,
            reg.I2C_MST_CTRL: 0x4D,
            reg.I2C_SLV0_ADDR: 0x8C,
            reg.I2C_SLV0_REG: reg.AK_ST1,
            reg.I2C_SLV0_CTRL: 0x88,
            reg.INT_ENABLE: 0x01,
        }.items()
        if value
    }
    assert bench.register(reg.PWR_MGMT_1) == 0x01
    assert bench.register(reg.USER_CTRL) == 0x20


def test_the_magnetometer_is_left_measuring_100_times_a_second_at_16_bit() -> None:
    bench = Bench()
    bench.start()
    bench.sim.write(reg.ADDRESS, reg.USER_CTRL, b"\0")
    bench.sim.write(reg.ADDRESS, reg.INT_PIN_CFG, b"\x02")
    assert bench.sim.read(reg.AK_ADDRESS, reg.AK_CNTL1, 1) == b"\x16"


def test_the_auxiliary_master_is_stopped_before_its_next_transfer_is_set_up() -> None:
    """Else a round that falls in between would use the old half of it."""
    bench = Bench()
    bench.start()
    running = False
    for register, value in bench.wire.writes:
        if register == reg.I2C_SLV0_CTRL:
            running = bool(value & reg.I2C_SLV0_EN)
        elif register in (reg.I2C_SLV0_ADDR, reg.I2C_SLV0_REG, reg.I2C_SLV0_DO):
            assert not running
    assert running


@pytest.mark.parametrize("rate", [1000.0, 500.0, 333.0, 333.333, 200.0, 100.0, 4.0, 3.90625])
def test_a_rate_is_1000_divided_by_a_whole_number(rate: float) -> None:
    assert 1000.0 / Settings(rate).divisor == pytest.approx(rate, rel=0.0015)


@pytest.mark.parametrize(
    ("rate", "nearest"),
    [
        (300.0, "nearest: 250 and 333.333 Hz"),
        (750.0, "nearest: 500 and 1000 Hz"),
        (1500.0, "nearest: 1000 Hz"),
        (1.0, "nearest: 3.90625 Hz"),
        (5e-324, "nearest: 3.90625 Hz"),
        (0.0, "positive"),
        (-5.0, "positive"),
        (math.nan, "positive"),
        (math.inf, "positive"),
    ],
)
def test_a_rate_that_the_chip_has_not_is_refused_with_the_nearest(
    rate: float, nearest: str
) -> None:
    with pytest.raises(UsageError, match=nearest):
        Settings(rate)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        (
            {"gyro_range": 300},
            "gyro_range must be one of 250, 500, 1000, 2000 °/s, got 300; nearest: 250",
        ),
        ({"accel_range": 12}, "accel_range must be one of 2, 4, 8, 16 g, got 12; nearest: 8"),
        ({"dlpf": 0}, "dlpf must be one of 1, 2, 3, 4, 5, 6, got 0; nearest: 1"),
        ({"dlpf": 7}, "nearest: 6"),
    ],
)
def test_a_setting_that_the_chip_has_not_is_refused(setting: dict[str, int], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Settings(**setting)


# --- identity ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("who", "name"), [(0x71, "MPU-9250"), (0x73, "MPU-9255")])
def test_nine_axes_are_known_by_name(who: int, name: str) -> None:
    chip = Bench(who_am_i=who).start()
    assert (chip.name, chip.has_magnetometer) == (name, True)
    assert str(chip) == f"{name} at 0x68"


def test_an_mpu_6500_runs_on_six_axes_and_says_so() -> None:
    bench = Bench(who_am_i=0x70)
    chip = bench.start()
    assert str(chip) == "MPU-6500 at 0x68 (no magnetometer)"
    assert not chip.has_magnetometer
    bench.wire.reads.clear()
    reading = bench.next()
    assert reading.mag is None
    assert reading.accel == pytest.approx((0.0, 0.0, 9.81), abs=1e-3)
    assert bench.wire.reads[-1] == (reg.INT_STATUS, 15)


@pytest.mark.parametrize(
    ("who", "name"),
    [
        (0x68, "MPU-6050"),
        (0x74, "MPU-6515"),
        (0x78, "MPU-6880"),
        (0x75, "unknown"),
        (0x00, "unknown"),
    ],
)
def test_another_chip_is_named_and_left_alone(who: int, name: str) -> None:
    bench = Bench(who_am_i=who)
    bench.sim.write(reg.ADDRESS, reg.CONFIG, b"\x05")
    with pytest.raises(DeviceError, match=f"0x{who:02X} .{name}.*expected 0x71 .MPU-9250"):
        bench.start()
    assert bench.register(reg.CONFIG) == 5


def test_a_bus_that_nobody_drives_is_not_taken_for_a_chip() -> None:
    with pytest.raises(DeviceError, match="every byte reads as 0xFF: nobody drives the bus"):
        Bench(who_am_i=0xFF).start()


def test_an_absent_chip_is_an_error_that_names_the_address() -> None:
    bench = Bench()
    with pytest.raises(DeviceError, match="0x69"):
        Mpu9250(bench.sim, address=0x69, sleep=bench.clock.sleep)


def test_a_9250_whose_magnetometer_does_not_answer_is_refused() -> None:
    bench = Bench(who_am_i=0x70)
    bench.wire.falsify = lambda register, data: b"\x71" if register == reg.WHO_AM_I else data
    with pytest.raises(
        DeviceError, match="magnetometer of the MPU-9250 at 0x68 answers 0x00, expected 0x48"
    ):
        bench.start()


def test_factory_adjustments_of_a_stuck_bus_are_refused() -> None:
    with pytest.raises(DeviceError, match="its bus is stuck"):
        Bench(fuses=(255, 255, 255)).start()


def test_a_magnetometer_that_does_not_measure_is_refused() -> None:
    bench = Bench()
    reads = iter([b"\x48", b"\x80\x80\x80", b"\x10"])  # identity, fuses, mode: power-down
    bench.wire.falsify = lambda register, data: (
        next(reads) if register == reg.EXT_SENS_DATA_00 else data
    )
    with pytest.raises(DeviceError, match="stays in mode 0x10 after 0x16"):
        bench.start()


# --- the state it keeps --------------------------------------------------------------------------


def test_a_chip_that_lost_its_supply_is_found_out_and_configured_again() -> None:
    bench = Bench()
    chip = bench.start()
    chip.verify()
    bench.sim.write(reg.ADDRESS, reg.PWR_MGMT_1, bytes((reg.H_RESET,)))
    bench.clock.sleep(0.2)
    with pytest.raises(DeviceError, match="MPU-9250 at 0x68 lost its configuration: register 0x1A"):
        chip.verify()
    chip.configure()
    chip.verify()
    assert bench.next().mag is not None


def test_a_chip_that_forgets_what_it_is_told_is_refused() -> None:
    bench = Bench()
    bench.wire.falsify = lambda register, data: b"\0" if register == reg.ACCEL_CONFIG else data
    with pytest.raises(DeviceError, match="register 0x1C holds 0x00, expected 0x08"):
        bench.start()


# --- readings ------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", range(4))
@pytest.mark.parametrize("axis", [X, Y, Z, UNIT])
def test_a_reading_is_the_truth_to_a_count_in_every_range(k: int, axis: Vector) -> None:
    settings = Settings(1000.0, GYRO_RANGES[k], ACCEL_RANGES[k], dlpf=1)
    bench = Bench(spinning(axis, math.radians(0.9 * GYRO_RANGES[k])), settings)
    reading = bench.first()
    truth = bench.sim.truth
    gyro_count = math.radians(GYRO_RANGES[k]) / 32768
    # the rate is within 1e-5 of constant in the first seconds of a turn of 1000
    assert reading.gyro == pytest.approx(truth.rate, abs=0.51 * gyro_count, rel=1e-5)
    assert reading.saturated == ()
    assert reading.temperature == pytest.approx(25.0, abs=0.5 / 333.87)

    bench = Bench(held(axis, 2.0), settings)
    bench.start()
    while (reading := bench.next()).mag is None:
        pass
    q = bench.sim.truth.rotor
    accel_count = ACCEL_RANGES[k] * 9.80665 / 32768
    assert reading.accel == pytest.approx(gravity(q), abs=0.51 * accel_count)
    assert reading.mag == pytest.approx(north(q), abs=0.51 * MAG_COUNT)
    assert reading.gyro == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("k", range(4))
def test_with_the_noise_of_the_data_sheet_readings_average_to_the_truth(k: int) -> None:
    errors = replace(
        IDEAL, gyro_noise=Errors().gyro_noise, accel_noise=Errors().accel_noise, mag_noise=0.6e-6
    )
    bench = Bench(held(UNIT, 1.0), Settings(100.0, GYRO_RANGES[k], ACCEL_RANGES[k]), errors=errors)
    bench.start()
    readings = [bench.next() for _ in range(400)]
    q = bench.sim.truth.rotor
    mags = [r.mag for r in readings if r.mag is not None]
    assert len(mags) >= 398
    for axis in range(3):
        # four times the deviation of a mean of 400
        mean = sum(r.gyro[axis] for r in readings) / 400
        assert mean == pytest.approx(0.0, abs=4.0 * math.radians(0.1) / 20.0)
        mean = sum(r.accel[axis] for r in readings) / 400
        assert mean == pytest.approx(gravity(q)[axis], abs=4.0 * 8.3 * 9.81e-3 / 20.0)
        mean = sum(m[axis] for m in mags) / len(mags)
        assert mean == pytest.approx(north(q)[axis], abs=4.0 * 0.6e-6 / 20.0)


@pytest.mark.parametrize(
    ("axis", "angle", "along"),
    [(Z, 0.0, X), (Z, -math.pi / 2, Y), (Y, math.pi / 2, Z), (Z, math.pi, (-1.0, 0.0, 0.0))],
)
def test_a_field_along_an_axis_of_the_sensor_is_reported_along_it(
    axis: Vector, angle: float, along: Vector
) -> None:
    bench = Bench(held(axis, angle), Settings(100.0), earth=Earth(9.81, 50e-6, 0.0))
    assert bench.first().mag == pytest.approx([50e-6 * n for n in along], abs=0.51 * MAG_COUNT)


def test_bytes_have_the_meaning_of_the_register_map() -> None:
    inertial = bytes.fromhex("01 4000 C000 0001 014E 0080 FF80 7FFF")
    magnetic = bytes.fromhex("01 0A00 1400 1E00 10")
    reading = Burst(250, 2, (1.0, 2.0, 3.0)).reading(inertial + magnetic)
    assert reading is not None
    g = 9.80665
    assert reading.accel == pytest.approx((g, -g, g / 16384))
    assert reading.temperature == pytest.approx(21.0 + 334 / 333.87)
    degree = math.radians(250.0) / 32768  # 131 LSB per °/s, rounded, in the data sheet
    assert reading.gyro == pytest.approx((128 * degree, -128 * degree, 32767 * degree))
    assert reading.mag == pytest.approx((20 * 2 * 0.15e-6, 10 * 0.15e-6, -30 * 3 * 0.15e-6))
    assert reading.saturated == ("gyro z",)


@pytest.mark.parametrize("fuses", [(128, 128, 128), (176, 178, 167), (0, 100, 254)])
def test_the_factory_adjustment_is_applied(fuses: tuple[int, int, int]) -> None:
    bench = Bench(held(UNIT, 1.0), Settings(100.0), fuses=fuses)
    reading = bench.first()
    largest = max((fuse - 128) * 0.5 / 128 + 1 for fuse in fuses)
    assert reading.mag == pytest.approx(north(bench.sim.truth.rotor), abs=0.51 * 0.15e-6 * largest)


def test_one_reading_is_one_transaction_of_23_bytes() -> None:
    bench = Bench()
    chip = bench.start()
    bench.wire.reads.clear()
    bench.clock.sleep(0.01)
    assert chip.read() is not None
    assert bench.wire.reads == [(reg.INT_STATUS, 23)]


def test_a_sample_is_read_once() -> None:
    bench = Bench(settings=Settings(200.0))
    chip = bench.start()
    bench.clock.sleep(0.1)
    assert chip.read() is not None
    assert chip.read() is None
    bench.clock.sleep(0.005)
    assert chip.read() is not None


@pytest.mark.parametrize("rate", [1000.0, 333.333, 200.0, 50.0, 4.0])
def test_samples_come_at_the_rate_chosen(rate: float) -> None:
    bench = Bench(motion("tumble"), Settings(rate))
    bench.start()
    stamps = []
    for _ in range(100):
        bench.next()
        stamps.append(bench.sim.truth.stamp)
    assert {b - a for a, b in pairwise(stamps)} == {round(1000.0 / rate) * 1_000_000}


def test_the_magnetometer_is_fresh_100_times_a_second_whatever_the_rate() -> None:
    bench = Bench(settings=Settings(1000.0), errors=Errors())
    bench.first()  # the first may bring what was measured before
    mags = [r.mag for r in (bench.next() for _ in range(1000)) if r.mag is not None]
    assert len(mags) == 100
    assert len(set(mags)) == 100

    bench = Bench(settings=Settings(50.0))
    bench.start()
    assert all(bench.next().mag is not None for _ in range(50))


def test_an_overflowing_magnetometer_gives_no_field_and_says_why() -> None:
    errors = replace(IDEAL, hard_iron=(4900e-6, 0.0, 0.0))
    reading = Bench(settings=Settings(100.0), errors=errors).first()
    assert reading.mag is None
    assert reading.mag_overflow
    assert reading.accel == pytest.approx((0.0, 0.0, 9.81), abs=1e-3)


def test_no_fresh_measurement_is_no_overflow() -> None:
    errors = replace(IDEAL, hard_iron=(4900e-6, 0.0, 0.0))
    bench = Bench(settings=Settings(1000.0), errors=errors)
    bench.first()
    overflows = sum(bench.next().mag_overflow for _ in range(1000))
    assert overflows == 100


@pytest.mark.parametrize("k", range(4))
@pytest.mark.parametrize(("axis", "sign"), [(0, 1.0), (1, -1.0), (2, 1.0)])
def test_a_saturated_axis_is_named(k: int, axis: int, sign: float) -> None:
    full = math.radians(GYRO_RANGES[k])
    direction: Vector = (sign * (axis == 0), sign * (axis == 1), sign * (axis == 2))
    moving = spinning(direction, 1.1 * full)
    reading = Bench(moving, Settings(1000.0, gyro_range=GYRO_RANGES[k])).first()
    assert reading.saturated == (f"gyro {'xyz'[axis]}",)
    assert sign * reading.gyro[axis] == pytest.approx(full, rel=1e-4)

    force = 1.1 * ACCEL_RANGES[k] * 9.80665
    offset: Vector = (force * direction[0], force * direction[1], force * direction[2])
    errors = replace(IDEAL, accel_offset=offset)
    reading = Bench(settings=Settings(accel_range=ACCEL_RANGES[k]), errors=errors).first()
    assert reading.saturated == (f"accel {'xyz'[axis]}",)
    assert sign * reading.accel[axis] == pytest.approx(force / 1.1, rel=1e-4)
