"""imu_driver: an MPU-9250 in, imu/data_raw, imu/mag and imu/temperature out."""

from __future__ import annotations

import math
import sys
import time
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.srv import SelfTest
from geometry_msgs.msg import QuaternionStamped
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from sensor_msgs.msg import Imu, MagneticField, Temperature
from std_srvs.srv import Trigger

from ..errors import AhrsError, UsageError
from ..filters.frames import WorldFrame
from ..mpu9250.burst import Reading
from ..mpu9250.chip import Settings
from ..mpu9250.corrector import Corrector
from ..mpu9250.detect import PROTOCOLS
from ..mpu9250.motion import MOTIONS, motion
from ..mpu9250.reader import Reader
from ..mpu9250.simulator import SimulatedMpu9250
from ..mpu9250.wiring import TRANSPORTS, Wiring
from ..rotor import IDENTITY
from . import lane, life, messages, qos
from .diagnostics import ERROR, OK, WARN, Diagnostics, Status
from .parameters import Parameters, Spec

LEVELS = (OK, WARN, ERROR)

PARAMETERS = [
    Spec("transport", "sim", f"one of {', '.join(TRANSPORTS)}; sim: the built-in simulator"),
    Spec("i2c_bus", 1, "i2c: number of the bus, 1 for /dev/i2c-1"),
    Spec("i2c_address", 104, "i2c: 104 (0x68), or 105 (0x69) where the board pulls AD0 up"),
    Spec("port", "/dev/ttyACM0", "serial: device file of the port"),
    Spec("baudrate", 921600, "serial: bits a second; boards with USB of their own ignore it"),
    Spec("protocol", "auto", f"serial: one of {', '.join(PROTOCOLS)}"),
    Spec("rate", 200.0, "sim, i2c: Hz, 1000 divided by a whole number"),
    Spec("gyro_range", 1000, "sim, i2c: ± °/s: 250, 500, 1000, 2000"),
    Spec("accel_range", 4, "sim, i2c: ± g: 2, 4, 8, 16"),
    Spec("dlpf", 2, "sim, i2c: low-pass 1: 184 Hz, 2: 92, 3: 41, 4: 20, 5: 10, 6: 5"),
    Spec("fifo", False, "sim, i2c: let the chip collect samples, for rates of 500 Hz and more"),
    Spec("bypass", False, "sim, i2c: read the magnetometer on the bus, not through the chip"),
    Spec("calibration_file", "", "YAML that `calibrate` has written; empty: raw data"),
    Spec("frame_id", "imu_link", "frame of all three sensors"),
    Spec("angular_velocity_stddev", 0.0017, "rad/s (data sheet, 92 Hz)", live=True),
    Spec("linear_acceleration_stddev", 0.078, "m/s² (data sheet, 94 Hz)", live=True),
    Spec("magnetic_field_stddev", 0.6e-6, "tesla (data sheet)", live=True),
    lane.FAST_LANE,
    Spec("sim_motion", "tumble", f"sim: motion of the sensor, one of {', '.join(MOTIONS)}"),
    Spec("sim_seed", 0, "sim: seed of the sensor's noise"),
]


class ImuDriver(Node):
    """Translates readings into messages."""

    def __init__(self) -> None:
        super().__init__("imu_driver")
        self._chosen = Parameters(self, PARAMETERS, accept=_accept, apply=self._apply)
        self._lane = lane.choose(self._chosen["fast_lane"])
        self._frame = self._lane.frame(self._chosen["frame_id"])
        self._unknown = self._lane.covariance(messages.UNKNOWN)
        self._apply(self._chosen.values)
        self._imu_out = qos.advertise(self, Imu, "imu/data_raw")
        self._mag_out = qos.advertise(self, MagneticField, "imu/mag")
        self._temperature_out = qos.advertise(self, Temperature, "imu/temperature")
        self._enu = WorldFrame("enu")

        values = self._chosen.values
        self._simulator: SimulatedMpu9250 | None = None
        if values["transport"] == "sim":
            self._truth_out = qos.advertise(self, QuaternionStamped, "ground_truth")
            # on the clock of the stamps, so that it knows the truth at each
            self._simulator = SimulatedMpu9250(
                motion(values["sim_motion"]), seed=values["sim_seed"], clock=time.time_ns
            )
        self._source = _wiring(values).source(_chip_settings(values), self._simulator)
        self._corrector = Corrector(values["calibration_file"])
        self._source.open()
        self._reader = Reader(self._source, self._on_reading)
        self._diagnostics = Diagnostics(self, "sensor", self._status, str(self._source))
        rate = "" if self._source.rate is None else f", {self._source.rate:g} Hz"
        self.get_logger().info(
            f"{self._source}{rate} → {self._imu_out.topic_name}, {self._mag_out.topic_name}"
        )
        self.create_service(Trigger, "~/calibrate_gyro", self._on_calibrate_gyro)
        self.create_service(SelfTest, "~/self_test", self._on_self_test)
        self._reader.start()

    def _apply(self, values: dict[str, Any]) -> None:
        self._gyro_covariance, self._accel_covariance, self._mag_covariance = (
            self._lane.covariance(messages.diagonal(values[f"{name}_stddev"] ** 2))
            for name in ("angular_velocity", "linear_acceleration", "magnetic_field")
        )

    def _on_reading(self, reading: Reading, stamp: int) -> None:
        """Publish one sample: all its messages share one stamp, the magnetometer's comes first."""
        reading = self._corrector.correct(reading, stamp)
        try:
            if reading.mag is not None and self._mag_out.wanted:
                self._mag_out.publish(
                    self._lane.magnetic_field(stamp, self._frame, reading.mag, self._mag_covariance)
                )
            if self._imu_out.wanted:
                self._imu_out.publish(
                    self._lane.imu(
                        stamp,
                        self._frame,
                        IDENTITY,
                        self._unknown,
                        reading.gyro,
                        self._gyro_covariance,
                        reading.accel,
                        self._accel_covariance,
                    )
                )
            if self._temperature_out.wanted and math.isfinite(reading.temperature):
                header = messages.header(stamp, self._chosen["frame_id"])
                self._temperature_out.publish(
                    Temperature(header=header, temperature=reading.temperature)
                )
            if self._simulator is not None and self._truth_out.wanted:
                self._publish_truth(self._simulator, stamp)
        except rclpy_implementation.RCLError:
            if rclpy.ok():  # else the context ended in between
                raise

    def _publish_truth(self, simulator: SimulatedMpu9250, stamp: int) -> None:
        truth = self._enu.update(simulator.truth_at(stamp).rotor)
        self._truth_out.publish(
            QuaternionStamped(
                header=messages.header(stamp, "map"),
                quaternion=messages.quaternion_message(truth),
            )
        )

    def _status(self, elapsed: float) -> Status:
        level, sentence, values = self._reader.verdict(elapsed)
        values = {"transport": self._chosen["transport"], **values, **self._corrector.report}
        return LEVELS[level], sentence, values

    def _on_calibrate_gyro(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        try:
            response.message = self._corrector.calibrate_gyro()
            response.success = True
        except AhrsError as error:
            response.message = str(error)
        return response

    def _on_self_test(self, _: SelfTest.Request, response: SelfTest.Response) -> SelfTest.Response:
        """Publish nothing for the second that the chip's self-test takes."""
        response.id = str(self._source)
        try:
            axes = self._reader.self_test()
        except AhrsError as error:
            response.status = [DiagnosticStatus(level=ERROR, name="self-test", message=str(error))]
            return response
        response.status = [
            DiagnosticStatus(level=OK if axis.passed else ERROR, name=axis.name, message=str(axis))
            for axis in axes
        ]
        response.passed = bytes((all(axis.passed for axis in axes),))
        return response

    def destroy_node(self) -> None:
        """Stop the reader first."""
        self._reader.end()
        super().destroy_node()


def _chip_settings(values: dict[str, Any]) -> Settings:
    names = ("rate", "gyro_range", "accel_range", "dlpf", "fifo", "bypass")
    return Settings(*(values[name] for name in names))


def _wiring(values: dict[str, Any]) -> Wiring:
    names = ("transport", "i2c_bus", "i2c_address", "port", "baudrate", "protocol")
    return Wiring(*(values[name] for name in names))


def _accept(values: dict[str, Any]) -> None:
    """Raise an `AhrsError` if the values make no driver."""
    for name, value in values.items():
        if name.endswith("_stddev") and not 0.0 <= value < math.inf:
            raise UsageError(f"{name} must be 0 or more, got {value}.")
    _wiring(values)
    _chip_settings(values)
    motion(values["sim_motion"])


def main() -> None:
    """Run the node."""
    sys.exit(life.run("imu_driver", ImuDriver, PARAMETERS))


if __name__ == "__main__":
    main()
