"""How sensor messages pass through a node: as Python messages, or as bytes in the fast lane.

A node reads the same with either. What a lane makes of a frame, of a covariance or of a message
that it passes on only that lane understands.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

from geometry_msgs.msg import Vector3Stamped
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu, MagneticField
from std_msgs.msg import Float64

from ..rotor import Rotor, Vector
from . import cdr, messages
from .cdr import Inertial, Magnetic
from .parameters import Spec

FAST_LANE = Spec("fast_lane", True, "false: messages pass as Python's, at twice the cost")


class Lane:
    """Python messages."""

    raw = False  # whether messages come as bytes
    slow = 0  # messages that the fast lane left to ROS
    malformed = 0  # messages that nobody could read

    def inertial(self, message: Any) -> Inertial | None:
        """Read a sensor_msgs/Imu; None if it is malformed."""
        if not self._has_time(message):
            return None
        gyro, accel = messages.rates_and_force(message)
        return messages.nanoseconds(message.header.stamp), gyro, accel, message

    def magnetic(self, message: Any) -> Magnetic | None:
        """Read a sensor_msgs/MagneticField; None if it is malformed."""
        if not self._has_time(message):
            return None
        stamp = messages.nanoseconds(message.header.stamp)
        field = messages.reported(message.magnetic_field, message.magnetic_field_covariance)
        return Magnetic(stamp, field)

    def _has_time(self, message: Any) -> bool:
        """Whether its stamp is one; else it is malformed."""
        found: bool = message.header.stamp.nanosec < cdr.SECOND
        self.malformed += not found
        return found

    def oriented(
        self, message: Any, orientation: Rotor, orientation_covariance: Any, gyro: Vector
    ) -> Any:
        """A sensor_msgs/Imu that was read, with this orientation and these rates (rad/s)."""
        message.orientation = messages.quaternion_message(orientation)
        message.orientation_covariance = orientation_covariance
        message.angular_velocity = messages.vector_message(gyro)
        return message

    def stamped(self, message: Any, stamp: int) -> Any:
        """The same with another stamp (ns)."""
        message.header.stamp = messages.time(stamp)
        return message

    def without_rates(self, message: Any) -> Any:
        """The same, saying that its rates are not reported (REP-145)."""
        message.angular_velocity_covariance = messages.UNKNOWN
        return message

    def without_force(self, message: Any) -> Any:
        """The same, saying that its specific force is not reported; it is zero."""
        message.linear_acceleration = messages.vector_message((0.0, 0.0, 0.0))
        message.linear_acceleration_covariance = messages.UNKNOWN
        return message

    def frame_of(self, message: Any) -> Any:
        """The frame of a message that was read."""
        return message.header.frame_id

    def imu(
        self,
        stamp: int,
        frame: Any,
        orientation: Rotor,
        orientation_covariance: Any,
        gyro: Vector,
        gyro_covariance: Any,
        accel: Vector,
        accel_covariance: Any,
    ) -> Any:
        """Write a sensor_msgs/Imu; ``stamp`` in ns."""
        return Imu(
            header=messages.header(stamp, frame),
            orientation=messages.quaternion_message(orientation),
            orientation_covariance=orientation_covariance,
            angular_velocity=messages.vector_message(gyro),
            angular_velocity_covariance=gyro_covariance,
            linear_acceleration=messages.vector_message(accel),
            linear_acceleration_covariance=accel_covariance,
        )

    def magnetic_field(self, stamp: int, frame: Any, field: Vector, covariance: Any) -> Any:
        """Write a sensor_msgs/MagneticField."""
        return MagneticField(
            header=messages.header(stamp, frame),
            magnetic_field=messages.vector_message(field),
            magnetic_field_covariance=covariance,
        )

    def vector(self, stamp: int, frame: Any, v: Vector) -> Any:
        """Write a geometry_msgs/Vector3Stamped."""
        header = messages.header(stamp, frame)
        return Vector3Stamped(header=header, vector=messages.vector_message(v))

    def number(self, value: float) -> Any:
        """Write a std_msgs/Float64."""
        return Float64(data=value)

    def frame(self, name: str) -> Any:
        """A frame by its name."""
        return name

    def name(self, frame: Any) -> str:
        """The name of a frame."""
        return str(frame)

    def covariance(self, values: Sequence[float]) -> Any:
        """A covariance by its nine elements."""
        return values


class FastLane(Lane):
    """Bytes. What `cdr` refuses takes the way through a Python message."""

    raw = True
    oriented = staticmethod(cdr.oriented)
    stamped = staticmethod(cdr.stamped)
    without_rates = staticmethod(cdr.without_rates)
    without_force = staticmethod(cdr.without_force)
    frame_of = staticmethod(cdr.frame_of)
    imu = staticmethod(cdr.imu)
    magnetic_field = staticmethod(cdr.magnetic_field)
    vector = staticmethod(cdr.vector)
    number = staticmethod(cdr.number)
    frame = staticmethod(cdr.frame)
    name = staticmethod(cdr.name)
    covariance = staticmethod(cdr.covariance)

    def inertial(self, message: bytes) -> Inertial | None:
        try:
            return cdr.inertial(message)
        except cdr.ForeignError:
            return self._rewritten(message, Imu, cdr.inertial)

    def magnetic(self, message: bytes) -> Magnetic | None:
        try:
            return cdr.magnetic(message)
        except cdr.ForeignError:
            return self._rewritten(message, MagneticField, cdr.magnetic)

    def _rewritten(self, message: bytes, kind: type, read: Callable[[bytes], Any]) -> Any:
        """Read the message as ROS reads it and writes it itself; None if it is malformed."""
        try:
            found = read(serialize_message(deserialize_message(message, kind)))
        except Exception:  # each middleware has its own
            self.malformed += 1
            return None
        self.slow += 1
        return found


def choose(fast: bool) -> Lane:
    """The fast lane where it is wanted and the machine speaks its CDR."""
    return FastLane() if fast and sys.byteorder == "little" else Lane()
