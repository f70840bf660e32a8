"""Recordings out, as rosbag2 bags that Jazzy's `ros2 bag` plays."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from ..errors import RecordingError
from ..filters.samples import Stamps
from .needs import needed_for
from .recording import Progress, Recording, times
from .wire import BOOL, IMU, MAGNETIC_FIELD, QUATERNION, encode, encode_bool

if TYPE_CHECKING:
    from rosbags.interfaces import Qos

Storage = Literal["mcap", "sqlite3"]
METADATA_VERSION: Literal[9] = 9  # Jazzy's
BLOCK = 8192  # messages between two reports of progress


class _Stream(NamedTuple):
    topic: str
    kind: str
    received: Stamps
    messages: Iterator[bytes]
    latched: bool = False


def write(
    recording: Recording,
    folder: Path | str,
    storage: Storage = "mcap",
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> None:
    """Write a rosbag2 folder; what `load` makes of it is the same recording.

    ``/imu/data_raw``, ``/imu/mag``, ``/ground_truth`` (where the rotor is known) and
    ``/ground_truth/movement`` (at the start and at each change), in the order received; of
    messages received at the same time the Imu is the last, so that a live node has all that
    belongs to it. An existing folder is refused, or with ``overwrite`` replaced if it is a bag.
    Nothing is left behind if writing fails.
    """
    folder = Path(folder)
    with needed_for(f"writing {folder.name}"):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    if folder.exists():
        if not overwrite:
            raise RecordingError(f"{folder} exists already; --overwrite replaces it.")
        if not (folder / "metadata.yaml").is_file():
            raise RecordingError(f"{folder} exists and is not a rosbag2 folder: not replaced.")
    types = get_typestore(Stores.ROS2_JAZZY)
    streams = _streams(recording)
    received = np.concatenate([stream.received for stream in streams])
    stream_of = np.repeat(np.arange(len(streams)), [len(stream.received) for stream in streams])
    order = np.lexsort((stream_of, received))
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as scratch:
            draft = Path(scratch) / folder.name
            plugin = StoragePlugin[storage.upper()]
            with Writer(draft, version=METADATA_VERSION, storage_plugin=plugin) as writer:
                connections = [
                    writer.add_connection(
                        stream.topic,
                        stream.kind,
                        typestore=types,
                        offered_qos_profiles=[_qos(stream.latched)],
                    )
                    for stream in streams
                ]
                pending = zip(received[order].tolist(), stream_of[order].tolist(), strict=True)
                for done, (time, which) in enumerate(pending):
                    writer.write(connections[which], time, next(streams[which].messages))
                    if progress and done % BLOCK == 0:
                        progress(done / len(order))
            if folder.exists():
                shutil.rmtree(folder)
            draft.rename(folder)
    except OSError as error:
        raise RecordingError(f"{folder} cannot be written: {error.strerror or error}.") from None


def _streams(recording: Recording) -> list[_Stream]:
    """What is to be written, in the order in which messages of one time follow each other."""
    streams = []
    if recording.reference is not None and recording.reference_stamps is not None:
        received = times(recording.reference_received, recording.reference_stamps)
        if recording.movement is not None and len(recording.movement):
            changes = np.diff(recording.movement, prepend=not recording.movement[0])
            values = (encode_bool(value) for value in recording.movement[changes].tolist())
            streams.append(
                _Stream("/ground_truth/movement", BOOL, received[changes], values, latched=True)
            )
        known = ~np.isnan(recording.reference).any(axis=1)
        streams.append(
            _Stream(
                "/ground_truth",
                QUATERNION,
                received[known],
                encode(
                    QUATERNION,
                    "map",
                    recording.reference_stamps[known],
                    recording.reference[known][:, [1, 2, 3, 0]],
                ),
            )
        )
    if len(recording.mag):
        field = np.zeros((len(recording.mag), 12))
        field[:, :3] = recording.mag
        streams.append(
            _Stream(
                "/imu/mag",
                MAGNETIC_FIELD,
                times(recording.mag_received, recording.mag_stamps),
                encode(MAGNETIC_FIELD, "imu_link", recording.mag_stamps, field),
            )
        )
    inertial = np.zeros((len(recording), 37))
    inertial[:, 3] = 1.0  # an orientation of no turn, and
    inertial[:, 4] = -1.0  # not reported (REP-145)
    inertial[:, 13:16] = recording.gyro
    inertial[:, 25:28] = recording.accel
    streams.append(
        _Stream(
            "/imu/data_raw",
            IMU,
            times(recording.received, recording.stamps),
            encode(IMU, "imu_link", recording.stamps, inertial),
        )
    )
    return streams


def _qos(latched: bool) -> Qos:
    """Reliable, as REP-2003 asks of a publisher; latched: for those who join late as well."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    for_ever = QosTime(9223372036, 854775807)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1 if latched else 10,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=for_ever,
        lifespan=for_ever,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=for_ever,
        avoid_ros_namespace_conventions=False,
    )
