"""Single messages between CDR bytes and floats: the fast lane of the live nodes.

Only plain little-endian CDR (OMG DDS-XTypes 7.4), which is what ROS 2 speaks on the machines it
runs on; the layouts are those of `wire`. A frame stays the bytes that it is in the message, and so
does a covariance, because both are only passed on.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple

from ..errors import RecordingError
from ..rotor import Rotor, Vector

ENCAPSULATION = b"\x00\x01"  # plain CDR, little-endian; two bytes of options follow
PLAIN = ENCAPSULATION + b"\x00\x00"
NONE: Vector = (math.nan, math.nan, math.nan)

NAME = 12  # where the length of the frame's name begins: behind encapsulation and stamp
STAMPED = struct.Struct("<4siI")
HEAD = "<2s2xiI"
IMU = "104x3d72s3d72s"  # behind the frame; the orientation is passed over
FIELD = "3dd64x"
LENGTHS = 64  # of frames' names, that are remembered
VECTOR, COVARIANCE = (struct.Struct(f"<{n}d") for n in (3, 9))
NUMBER = struct.Struct("<4sd")
UNREPORTED = struct.pack("<d", -1.0)  # begins a covariance (REP-145)
SECOND = 1_000_000_000  # ns


# A sensor_msgs/Imu without its orientation: stamp (ns), frame, rates (rad/s) and their covariance,
# specific force (m/s²) and its covariance; NaN for what is not reported (REP-145). A tuple without
# names: it is made for each sample.
Inertial = tuple[int, Any, Vector, Any, Vector, Any]


class Magnetic(NamedTuple):
    """A sensor_msgs/MagneticField."""

    stamp: int  # ns
    field: Vector  # tesla


class ForeignError(RecordingError):
    """The bytes are no such message in plain little-endian CDR."""


def inertial(data: bytes) -> Inertial:
    """Read a sensor_msgs/Imu; `ForeignError` if it is not understood."""
    try:
        kind, sec, nanosec, frame, gx, gy, gz, gyro_covariance, ax, ay, az, accel_covariance = (
            _stamped(data[NAME : NAME + 4], IMU).unpack_from(data)
        )
    except struct.error:
        raise ForeignError from None
    if kind != ENCAPSULATION or nanosec >= SECOND:
        raise ForeignError
    return (
        sec * SECOND + nanosec,
        frame,
        NONE if gyro_covariance.startswith(UNREPORTED) else (gx, gy, gz),
        gyro_covariance,
        NONE if accel_covariance.startswith(UNREPORTED) else (ax, ay, az),
        accel_covariance,
    )


def magnetic(data: bytes) -> Magnetic:
    """Read a sensor_msgs/MagneticField; `ForeignError` if it is not understood."""
    try:
        kind, sec, nanosec, _, x, y, z, variance = _stamped(
            data[NAME : NAME + 4], FIELD
        ).unpack_from(data)
    except struct.error:
        raise ForeignError from None
    if kind != ENCAPSULATION or nanosec >= SECOND:
        raise ForeignError
    return Magnetic(sec * SECOND + nanosec, NONE if variance == -1.0 else (x, y, z))


@lru_cache(LENGTHS)
def _stamped(length: bytes, behind: str) -> struct.Struct:
    """A message with a header whose frame has a name of this length (with its NUL)."""
    # CDR aligns from behind the encapsulation, and the name ends at 12 + length from there.
    start = 4 + (NAME + int.from_bytes(length, "little") + 7 & -8)
    return struct.Struct(f"{HEAD}{start - NAME}s{behind}")


def imu(
    stamp: int,
    frame: bytes,
    orientation: Rotor,
    orientation_covariance: bytes,
    gyro: Vector,
    gyro_covariance: bytes,
    accel: Vector,
    accel_covariance: bytes,
) -> bytes:
    """Write a sensor_msgs/Imu."""
    w, x, y, z = orientation
    gx, gy, gz = gyro
    ax, ay, az = accel
    return _whole_imu(len(frame)).pack(
        PLAIN, stamp // SECOND, stamp % SECOND, frame, x, y, z, w, orientation_covariance,
        gx, gy, gz, gyro_covariance, ax, ay, az, accel_covariance,
    )  # fmt: skip


@cache
def _whole_imu(frame: int) -> struct.Struct:
    """A sensor_msgs/Imu whose frame takes so many bytes: one call is faster than eight."""
    return struct.Struct(f"<4siI{frame}s4d72s3d72s3d72s")


def magnetic_field(stamp: int, frame: bytes, field: Vector, covariance: bytes) -> bytes:
    """Write a sensor_msgs/MagneticField."""
    return vector(stamp, frame, field) + covariance


def vector(stamp: int, frame: bytes, v: Vector) -> bytes:
    """Write a geometry_msgs/Vector3Stamped."""
    head = STAMPED.pack(PLAIN, *divmod(stamp, SECOND))
    return head + frame + VECTOR.pack(*v)


def number(value: float) -> bytes:
    """Write a std_msgs/Float64."""
    return NUMBER.pack(PLAIN, value)


def frame(name: str) -> bytes:
    """The bytes of a frame's name: its length, itself, NUL, and what aligns a double."""
    text = name.encode() + b"\0"
    return struct.pack("<I", len(text)) + text + bytes(-(NAME + len(text)) % 8)


def name(frame: bytes) -> str:
    """The name in these bytes."""
    return frame[4:].split(b"\0", 1)[0].decode(errors="replace")


def covariance(values: Sequence[float]) -> bytes:
    """The bytes of a 3 × 3 covariance, row-major."""
    return COVARIANCE.pack(*values)
