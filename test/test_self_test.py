"""The chip's self-test tells axes that answer as in the factory from axes that do not."""

from __future__ import annotations

import pytest

from stateful_ahrs.errors import DeviceError
from stateful_ahrs.mpu9250 import registers as reg
from stateful_ahrs.mpu9250.burst import AXES
from stateful_ahrs.mpu9250.chip import Mpu9250
from stateful_ahrs.mpu9250.motion import motion
from stateful_ahrs.mpu9250.self_test import Axis, self_test
from stateful_ahrs.mpu9250.simulator import SimulatedMpu9250, VirtualClock


def result(
    name: str = "rest", response: dict[int, float] | None = None, **options: object
) -> list[Axis]:
    clock = VirtualClock()
    sim = SimulatedMpu9250(motion(name), clock=clock, **options)  # type: ignore[arg-type]
    clock.sleep(3.0)
    for axis, part in (response or {}).items():
        sim.self_test_response[axis] = part
    return self_test(sim, sleep=clock.sleep)


def test_a_sound_chip_passes_on_every_axis_with_the_factorys_response():
    axes = result()
    assert [axis.name for axis in axes] == list(AXES)
    assert all(axis.passed for axis in axes)
    # 200 samples of 8 mg and 0.1 °/s, against 0.43 g and 57 °/s
    assert [axis.ratio for axis in axes] == pytest.approx([1.0] * 6, abs=0.005)


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("response", [0.1, 0.45, -1.0])
def test_an_axis_that_answers_weakly_fails_alone(axis: int, response: float):
    axes = result(response={axis: response})
    assert [name for name, passed, *_ in axes if not passed] == [AXES[axis]]
    assert f"{AXES[axis]}: FAIL, {response:.2f} of the factory's" in str(axes[axis])


def test_only_the_accelerometer_has_an_upper_limit():
    axes = result(response={0: 1.55, 3: 1.55})
    assert [axis.name for axis in axes if not axis.passed] == ["accel x"]


def test_without_a_factory_trim_the_response_itself_is_judged():
    # 2620 counts times 1.01^-1: 0.16 g and 20 °/s, below 0.225 g and 60 °/s
    assert not any(axis.passed for axis in result(trims=(0,) * 6))
    axes = result(trims=(0,) * 6, response=dict(enumerate([2.9] * 3 + [3.5] * 3)))
    assert all(axis.passed for axis in axes)
    assert str(axes[0]) == "accel x: pass, response 0.46 g"
    assert str(axes[5]) == "gyro z: pass, response 69 °/s"


@pytest.mark.parametrize("name", ["tumble", "two_turns"])  # the second about the vertical
def test_a_chip_in_motion_is_not_judged(name: str):
    with pytest.raises(DeviceError, match="moved during its self-test"):
        result(name)


def test_a_chip_without_a_magnetometer_can_be_tested():
    assert all(axis.passed for axis in result(who_am_i=0x70))


def test_a_dead_magnetometer_does_not_keep_the_other_axes_from_their_test():
    clock = VirtualClock()
    sim = SimulatedMpu9250(motion("rest"), clock=clock)
    sim.mag_gone = True
    clock.sleep(0.2)
    assert all(axis.passed for axis in self_test(sim, sleep=clock.sleep))


def test_the_chip_measures_again_once_it_is_configured_anew():
    clock = VirtualClock()
    sim = SimulatedMpu9250(motion("rest"), clock=clock)
    clock.sleep(0.2)
    self_test(sim, sleep=clock.sleep)
    assert sim.read(reg.ADDRESS, reg.GYRO_CONFIG, 2) == b"\0\0"
    chip = Mpu9250(sim, sleep=clock.sleep)
    clock.sleep(0.01)
    reading = chip.read()
    assert reading is not None
    assert reading.accel == pytest.approx((0.0, 0.0, 9.81), abs=0.5)


def test_a_chip_that_takes_no_samples_is_told_of():
    clock = VirtualClock()
    sim = SimulatedMpu9250(motion("rest"), clock=clock)
    clock.sleep(0.2)
    with pytest.raises(DeviceError, match="1 samples, expected 200"):
        self_test(sim, sleep=lambda seconds: clock.sleep(seconds if seconds >= 1e-3 else 0.0))
