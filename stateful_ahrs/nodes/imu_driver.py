"""imu_driver: an MPU-9250 in, imu/data_raw, imu/mag and imu/temperature out."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import asdict
from typing import Any

import rclpy
from geometry_msgs.msg import QuaternionStamped
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from sensor_msgs.msg import Imu, MagneticField, Temperature
from std_msgs.msg import Header

from ..errors import DeviceError, UsageError
from ..filters.frames import WorldFrame
from ..mpu9250.burst import Reading
from ..mpu9250.chip import Mpu9250, Settings
from ..mpu9250.motion import MOTIONS, motion
from ..mpu9250.reader import Reader
from ..mpu9250.simulator import SimulatedMpu9250
from . import life, messages, qos
from .diagnostics import ERROR, OK, WARN, Diagnostics, Once, Status
from .parameters import Parameters, Spec

TRANSPORTS = ("sim",)

PARAMETERS = [
    Spec("transport", "sim", f"one of {', '.join(TRANSPORTS)}; sim: the built-in simulator"),
    Spec("rate", 200.0, "Hz: 1000 divided by a whole number"),
    Spec("gyro_range", 1000, "± °/s: 250, 500, 1000, 2000"),
    Spec("accel_range", 4, "± g: 2, 4, 8, 16"),
    Spec("dlpf", 2, "low-pass: 1: 184 Hz, 2: 92, 3: 41, 4: 20, 5: 10, 6: 5"),
    Spec("frame_id", "imu_link", "frame of all three sensors"),
    Spec("angular_velocity_stddev", 0.0017, "rad/s (data sheet, 92 Hz)", live=True),
    Spec("linear_acceleration_stddev", 0.078, "m/s² (data sheet, 94 Hz)", live=True),
    Spec("magnetic_field_stddev", 0.6e-6, "tesla (data sheet)", live=True),
    Spec("sim_motion", "tumble", f"motion of the simulated sensor: {', '.join(MOTIONS)}"),
    Spec("sim_seed", 0, "seed of the simulated sensor's noise"),
]


class ImuDriver(Node):
    """Translates the chip's readings into messages."""

    def __init__(self) -> None:
        super().__init__("imu_driver")
        self._chosen = Parameters(self, PARAMETERS, accept=_accept, apply=self._apply)
        self._apply(self._chosen.values)
        self._once = Once(self)
        self._samples_before = self._mag_samples_before = 0
        self._imu_out = self._advertise(Imu, "imu/data_raw")
        self._mag_out = self._advertise(MagneticField, "imu/mag")
        self._temperature_out = self._advertise(Temperature, "imu/temperature")
        self._truth_out = self._advertise(QuaternionStamped, "ground_truth")
        self._enu = WorldFrame("enu")
        self._lost: DeviceError | None = None

        self._bus = SimulatedMpu9250(
            motion(self._chosen["sim_motion"]), seed=self._chosen["sim_seed"]
        )
        self._chip = Mpu9250(self._bus, _chip_settings(self._chosen.values))
        self._reader = Reader(self._chip, self._on_reading, self._on_lost, self._now)
        self._diagnostics = Diagnostics(self, "sensor", self._status, str(self._chip))
        self.get_logger().info(
            f"{self._chip}, {self._chosen['transport']}, {1e3 / self._chip.settings.divisor:g} Hz "
            f"→ {self._imu_out.topic_name}, {self._mag_out.topic_name}"
        )
        self._reader.start()

    def _advertise(self, kind: type, topic: str) -> Any:
        return self.create_publisher(
            kind, topic, qos.PUBLISHER, qos_overriding_options=qos.overridable()
        )

    def _apply(self, values: dict[str, Any]) -> None:
        self._gyro_covariance = messages.diagonal(values["angular_velocity_stddev"] ** 2)
        self._accel_covariance = messages.diagonal(values["linear_acceleration_stddev"] ** 2)
        self._mag_covariance = messages.diagonal(values["magnetic_field_stddev"] ** 2)

    def _now(self) -> int:
        return time.time_ns()

    def _on_reading(self, reading: Reading, stamp: int) -> None:
        """Publish one sample: all its messages share one stamp, the magnetometer's comes first."""
        header = Header(stamp=messages.time(stamp), frame_id=self._chosen["frame_id"])
        try:
            if reading.mag is not None:
                field = messages.vector_message(reading.mag)
                self._mag_out.publish(
                    MagneticField(
                        header=header,
                        magnetic_field=field,
                        magnetic_field_covariance=self._mag_covariance,
                    )
                )
            self._imu_out.publish(
                Imu(
                    header=header,
                    orientation_covariance=messages.UNKNOWN,
                    angular_velocity=messages.vector_message(reading.gyro),
                    angular_velocity_covariance=self._gyro_covariance,
                    linear_acceleration=messages.vector_message(reading.accel),
                    linear_acceleration_covariance=self._accel_covariance,
                )
            )
            if self._temperature_out.get_subscription_count() > 0:
                self._temperature_out.publish(
                    Temperature(header=header, temperature=reading.temperature)
                )
            if self._truth_out.get_subscription_count() > 0:
                self._publish_truth(header)
        except rclpy_implementation.RCLError:
            if rclpy.ok():  # else the context ended in between
                raise

    def _publish_truth(self, header: Header) -> None:
        truth = self._enu.update(self._bus.truth.rotor)
        self._truth_out.publish(
            QuaternionStamped(
                header=Header(stamp=header.stamp, frame_id="map"),
                quaternion=messages.quaternion_message(truth),
            )
        )

    def _on_lost(self, error: DeviceError) -> None:
        self._lost = error
        self.get_logger().error(str(error))

    def _status(self, elapsed: float) -> Status:
        counts = self._reader.counts
        rate = (counts.samples - self._samples_before) / elapsed
        mag_rate = (counts.mag_samples - self._mag_samples_before) / elapsed
        self._samples_before, self._mag_samples_before = counts.samples, counts.mag_samples
        values: dict[str, object] = {
            "transport": self._chosen["transport"],
            "imu_rate_hz": rate,
            "mag_rate_hz": mag_rate,
            **asdict(counts),
        }
        if self._lost is not None:
            return ERROR, str(self._lost), values
        expected = 1e3 / self._chip.settings.divisor
        if rate < 0.9 * expected:
            return WARN, f"{rate:.1f} samples a second, expected {expected:g}.", values
        if self._chip.has_magnetometer and mag_rate == 0.0:
            return WARN, "The magnetometer gives no samples.", values
        return OK, f"{self._chip}: {expected:g} Hz.", values

    def destroy_node(self) -> None:
        """Stop the reader first."""
        self._reader.end()
        super().destroy_node()


def _chip_settings(values: dict[str, Any]) -> Settings:
    return Settings(values["rate"], values["gyro_range"], values["accel_range"], values["dlpf"])


def _accept(values: dict[str, Any]) -> None:
    """Raise an `AhrsError` if the values make no driver."""
    if values["transport"] not in TRANSPORTS:
        raise UsageError(
            f"transport must be one of {', '.join(TRANSPORTS)}, got {values['transport']!r}."
        )
    for name, value in values.items():
        if name.endswith("_stddev") and not 0.0 <= value < math.inf:
            raise UsageError(f"{name} must be 0 or more, got {value}.")
    _chip_settings(values)
    motion(values["sim_motion"])


def main() -> None:
    """Run the node."""
    sys.exit(life.run("imu_driver", ImuDriver))


if __name__ == "__main__":
    main()
