"""Messages ↔ floats."""

from __future__ import annotations

import math
from collections.abc import Sequence

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Vector3
from sensor_msgs.msg import Imu
from std_msgs.msg import Header

from ..rotor import Rotor, Vector
from .cdr import NONE

UNKNOWN = [-1.0] + [0.0] * 8  # REP-145: the field is not reported


def nanoseconds(stamp: Time) -> int:
    """A stamp as ns."""
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def time(stamp: int) -> Time:
    """Nanoseconds as a stamp."""
    sec, nanosec = divmod(stamp, 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def header(stamp: int, frame: str) -> Header:
    """A header; ``stamp`` in ns."""
    return Header(stamp=time(stamp), frame_id=frame)


def vector(v: Vector3) -> Vector:
    """A message's vector as floats."""
    return (v.x, v.y, v.z)


def vector_message(v: Vector) -> Vector3:
    """Floats as a message's vector."""
    return Vector3(x=v[0], y=v[1], z=v[2])


def quaternion_message(q: Rotor) -> Quaternion:
    """A rotor as a message's quaternion, which is scalar last."""
    return Quaternion(w=q[0], x=q[1], y=q[2], z=q[3])


def rates_and_force(msg: Imu) -> tuple[Vector, Vector]:
    """Angular velocity and linear acceleration; NaN for what is not reported (REP-145)."""
    return (
        reported(msg.angular_velocity, msg.angular_velocity_covariance),
        reported(msg.linear_acceleration, msg.linear_acceleration_covariance),
    )


def reported(v: Vector3, covariance: Sequence[float]) -> Vector:
    """A vector; NaN if it is not reported (REP-145)."""
    return NONE if covariance[0] == -1.0 else vector(v)


def diagonal(variance: float) -> list[float]:
    """A 3 × 3 covariance, row-major."""
    return [variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance]


def about_the_vertical(tilt: float, heading: float) -> list[float]:
    """A 3 × 3 covariance, row-major, of standard deviations (rad) about level axes and vertical."""
    level, vertical = tilt * tilt, heading * heading
    return [level, 0.0, 0.0, 0.0, level, 0.0, 0.0, 0.0, vertical]


def finite(v: Vector) -> bool:
    """Whether all three are numbers."""
    return math.isfinite(v[0] + v[1] + v[2])
