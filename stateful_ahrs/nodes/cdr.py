"""Single messages between CDR bytes and floats: the fast lane of the live nodes.

Only plain little-endian CDR (OMG DDS-XTypes 7.4), which is what ROS 2 speaks on the machines it
runs on; the layouts are those of `wire`. What is only passed on stays the bytes that it is in the
message: the name of a frame, a covariance, and all of an Imu but its orientation and rates.
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
IMU = "104x3dd64x3dd64x"  # behind the frame; the orientation is passed over
TURNED = struct.Struct("<4d72s3d")  # of it orientation and rates, of which the filter has better
BEHIND_RATES, FORCE, IMU_SIZE = 128, 200, 296  # behind the frame: where these begin
FIELD = "3dd64x"
LENGTHS = 64  # of frames' names, that are remembered
VECTOR, COVARIANCE = (struct.Struct(f"<{n}d") for n in (3, 9))
NUMBER = struct.Struct("<4sd")
UNREPORTED = COVARIANCE.pack(-1.0, *[0.0] * 8)  # a covariance of what is not (REP-145)
SECOND = 1_000_000_000  # ns


# A sensor_msgs/Imu that is passed on: its bytes, and where in them the frame's name ends.
Message = tuple[bytes, int]

# What is read of it: stamp (ns), rates (rad/s), specific force (m/s²), NaN for what is not reported
# (REP-145), and the message. A tuple without names: it is made for each sample.
Inertial = tuple[int, Vector, Vector, Any]


class Magnetic(NamedTuple):
    """A sensor_msgs/MagneticField."""

    stamp: int  # ns
    field: Vector  # tesla


class ForeignError(RecordingError):
    """The bytes are no such message in plain little-endian CDR."""


def inertial(data: bytes) -> Inertial:
    """Read a sensor_msgs/Imu; `ForeignError` if it is not understood."""
    try:
        layout, start = _stamped(data[NAME : NAME + 4], IMU)
        kind, sec, nanosec, gx, gy, gz, gyro_variance, ax, ay, az, accel_variance = (
            layout.unpack_from(data)
        )
    except struct.error:
        raise ForeignError from None
    if kind != ENCAPSULATION or nanosec >= SECOND:
        raise ForeignError
    return (
        sec * SECOND + nanosec,
        NONE if gyro_variance == -1.0 else (gx, gy, gz),
        NONE if accel_variance == -1.0 else (ax, ay, az),
        (data, start),
    )


def magnetic(data: bytes) -> Magnetic:
    """Read a sensor_msgs/MagneticField; `ForeignError` if it is not understood."""
    try:
        layout, _ = _stamped(data[NAME : NAME + 4], FIELD)
        kind, sec, nanosec, x, y, z, variance = layout.unpack_from(data)
    except struct.error:
        raise ForeignError from None
    if kind != ENCAPSULATION or nanosec >= SECOND:
        raise ForeignError
    return Magnetic(sec * SECOND + nanosec, NONE if variance == -1.0 else (x, y, z))


@lru_cache(LENGTHS)
def _stamped(length: bytes, behind: str) -> tuple[struct.Struct, int]:
    """A message whose frame has a name of this length (with its NUL), and where that ends."""
    # CDR aligns from behind the encapsulation, and the name ends at 12 + length from there.
    start = 4 + (NAME + int.from_bytes(length, "little") + 7 & -8)
    return struct.Struct(f"{HEAD}{start - NAME}x{behind}"), start


def oriented(
    message: Message, orientation: Rotor, orientation_covariance: bytes, gyro: Vector
) -> bytes:
    """The sensor_msgs/Imu with this orientation and these rates (rad/s)."""
    data, start = message
    w, x, y, z = orientation
    gx, gy, gz = gyro
    turned = TURNED.pack(x, y, z, w, orientation_covariance, gx, gy, gz)
    rest = data[start + BEHIND_RATES : start + IMU_SIZE]
    return b"".join((PLAIN, data[4:start], turned, rest))


def stamped(message: Message, stamp: int) -> Message:
    """The same with another stamp (ns)."""
    data, start = message
    return STAMPED.pack(PLAIN, *divmod(stamp, SECOND)) + data[NAME:], start


def without_rates(message: Message) -> Message:
    """The same, saying that its rates are not reported (REP-145)."""
    data, start = message
    return data[: start + BEHIND_RATES] + UNREPORTED + data[start + FORCE :], start


def without_force(message: Message) -> Message:
    """The same, saying that its specific force is not reported; it is zero."""
    data, start = message
    return data[: start + FORCE] + bytes(24) + UNREPORTED + data[start + IMU_SIZE :], start


def frame_of(message: Message) -> bytes:
    """The bytes of its frame's name."""
    data, start = message
    return data[NAME:start]


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
