"""Where the numbers stand in the ROS messages that a recording is made of.

Each of these types is a header (stamp and frame name), at most one more frame name, and then
nothing but doubles. CDR (ROS 2: OMG DDS-XTypes 7.4) pads names and doubles to their own size and
ROS 1 does not; in both a word of four bytes comes first and the stamp next.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError
from ..filters.samples import Array, Stamps

IMU = "sensor_msgs/msg/Imu"
MAGNETIC_FIELD = "sensor_msgs/msg/MagneticField"
TEMPERATURE = "sensor_msgs/msg/Temperature"
QUATERNION = "geometry_msgs/msg/QuaternionStamped"
BOOL = "std_msgs/msg/Bool"


class Layout(NamedTuple):
    """What follows the stamp."""

    names: int  # header.frame_id and, where there is one, child_frame_id
    doubles: int


LAYOUTS = {
    IMU: Layout(1, 37),  # orientation x y z w, 9 covariances, rates 3 + 9, specific force 3 + 9
    MAGNETIC_FIELD: Layout(1, 12),  # field 3 + 9 covariances
    TEMPERATURE: Layout(1, 2),  # °C and variance
    QUATERNION: Layout(1, 4),  # x y z w
    "geometry_msgs/msg/PoseStamped": Layout(1, 7),  # position, x y z w
    "geometry_msgs/msg/TransformStamped": Layout(2, 7),  # translation, x y z w
    "nav_msgs/msg/Odometry": Layout(2, 85),  # position, x y z w, 36 covariances, twist 6 + 36
}
ROTORS = {  # the doubles x y z w of the orientation
    IMU: 0,
    QUATERNION: 0,
    "geometry_msgs/msg/PoseStamped": 3,
    "geometry_msgs/msg/TransformStamped": 3,
    "nav_msgs/msg/Odometry": 3,
}


def decode(kind: str, messages: Sequence[bytes], *, ros1: bool = False) -> tuple[Stamps, Array]:
    """Header stamps (n,) in ns and the doubles (n, m) of messages of one type.

    Raises RecordingError if a message is not one of that type.
    """
    layout = LAYOUTS[kind]
    size = 8 * layout.doubles
    big_endian = _big_endian(kind, messages, ros1)
    names, start = b"", 0
    doubles = []
    for message in messages:
        if start == 0 or message[12:start] != names:  # nearly always the names of the last one
            start = _first_double(message, layout.names, aligned=not ros1, big_endian=big_endian)
            names = message[12:start]
        doubles.append(message[start : start + size])
    if any(len(part) != size for part in doubles):
        shortest = min(map(len, messages))
        raise RecordingError(f"a message of {shortest} bytes is too short for a {kind}.")
    order = ">" if big_endian else "<"
    parts = np.frombuffer(b"".join(message[4:12] for message in messages), order + "u4")
    sec, nanosec = parts.reshape(-1, 2).astype(np.int64).T
    values = np.frombuffer(b"".join(doubles), order + "f8").reshape(-1, layout.doubles)
    return sec * 1_000_000_000 + nanosec, values.astype(np.float64, copy=False)


def decode_bool(messages: Sequence[bytes], *, ros1: bool = False) -> tuple[Stamps, Array]:
    """Stamps of zero, as it has none, and the values (n, 1), 0 or 1, of std_msgs/Bool messages."""
    at = 0 if ros1 else 4
    if any(len(message) <= at for message in messages):
        raise RecordingError(f"a message is too short for a {BOOL}.")
    values = np.array([message[at] != 0 for message in messages], dtype=float)
    return np.zeros(len(messages), np.int64), values.reshape(-1, 1)


def encode(kind: str, frame: str, stamps: Stamps, values: Array) -> Iterator[bytes]:
    """CDR messages, little-endian, of a type with one frame name; ``values`` (n, m) doubles."""
    name = struct.pack("<I", len(frame) + 1) + frame.encode("ascii") + b"\0"
    name += b"\0" * (-(8 + len(name)) % 8)
    layout = np.dtype(
        [
            ("encapsulation", "V4"),
            ("sec", "<u4"),
            ("nanosec", "<u4"),
            ("name", f"V{len(name)}"),
            ("values", "<f8", (LAYOUTS[kind].doubles,)),
        ]
    )
    messages = np.zeros(len(stamps), layout)
    messages["encapsulation"] = np.void(b"\x00\x01\x00\x00")
    messages["sec"], messages["nanosec"] = np.divmod(stamps, 1_000_000_000)
    messages["name"] = np.void(name)
    messages["values"] = values
    return (message.tobytes() for message in messages)


def encode_bool(value: bool) -> bytes:
    """A std_msgs/Bool as CDR, little-endian."""
    return b"\x00\x01\x00\x00" + bytes([value])


def _big_endian(kind: str, messages: Sequence[bytes], ros1: bool) -> bool:
    if ros1:
        return False
    found = {message[:2] for message in messages}
    if found <= {b"\x00\x01"}:
        return False
    if found == {b"\x00\x00"}:
        return True
    odd = next(iter(found - {b"\x00\x01"}))
    raise RecordingError(f"a message begins with {odd.hex() or 'nothing'}: not a {kind} in CDR.")


def _first_double(message: bytes, names: int, *, aligned: bool, big_endian: bool) -> int:
    at = 12
    for _ in range(names):
        if aligned:
            at += -at % 4
        at += 4 + int.from_bytes(message[at : at + 4], "big" if big_endian else "little")
    return at + (4 - at) % 8 if aligned else at
