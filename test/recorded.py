"""Small recordings and bags for the tests of `recordings`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stateful_ahrs.recordings import Recording

START = 1_700_000_000_123_456_789  # ns


def recording(rows: int = 50, *, mag_every: int = 2, truth: bool = True) -> Recording:
    """Noise at 200 Hz with a magnetometer at a part of it; the truth known in part."""
    random = np.random.default_rng(7)
    stamps = START + 5_000_000 * np.arange(rows)
    mag_stamps = stamps[::mag_every]
    rotors = random.normal(size=(rows, 4))
    rotors /= np.linalg.norm(rotors, axis=1, keepdims=True)
    rotors[: rows // 10] = np.nan
    return Recording(
        name="noise",
        stamps=stamps,
        gyro=random.normal(size=(rows, 3)),
        accel=random.normal(size=(rows, 3)),
        mag_stamps=mag_stamps,
        mag=5e-5 * random.normal(size=(len(mag_stamps), 3)),
        reference_stamps=stamps if truth else None,
        reference=rotors if truth else None,
        movement=np.arange(rows) // 13 % 2 == 1 if truth else None,
    )


def covariance(first: float) -> Any:
    """A covariance of zeros but for its first element."""
    return np.array([first] + [0.0] * 8)


class Bag:
    """Messages of any type, written by rosbags into a rosbag2 folder or a ROS 1 file."""

    def __init__(self, path: Path, *, storage: str = "MCAP", big_endian: bool = False) -> None:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_typestore

        self.ros1 = path.suffix == ".bag"
        self.little_endian = not big_endian
        self.types = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_JAZZY)
        plugin = rosbag2.StoragePlugin[storage]
        self.writer: Any = (
            rosbag1.Writer(path)
            if self.ros1
            else rosbag2.Writer(path, version=9, storage_plugin=plugin)
        )
        self.connections: dict[str, Any] = {}

    def __enter__(self) -> Bag:
        self.writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.writer.close()

    def topic(self, name: str, kind: str) -> None:
        """Announce a topic, on which there may be no message."""
        self.connections[name] = self.writer.add_connection(name, kind, typestore=self.types)

    def add(self, topic: str, message: Any, received: int) -> None:
        if topic not in self.connections:
            self.topic(topic, message.__msgtype__)
        self.writer.write(self.connections[topic], received, self.bytes(message))

    def bytes(self, message: Any) -> bytes:
        """The message as it stands in the bag."""
        kind = message.__msgtype__
        if self.ros1:
            return bytes(self.types.serialize_ros1(message, kind))
        return bytes(self.types.serialize_cdr(message, kind, little_endian=self.little_endian))

    def bool(self, value: bool) -> Any:
        return self._make("std_msgs/Bool", data=value)

    def _make(self, kind: str, **fields: Any) -> Any:
        package, name = kind.split("/")
        return self.types.types[f"{package}/msg/{name}"](**fields)

    def header(self, stamp: int, frame: str = "imu_link") -> Any:
        sec, nanosec = divmod(stamp, 10**9)
        time = self._make("builtin_interfaces/Time", sec=sec, nanosec=nanosec)
        seq = {"seq": 0} if self.ros1 else {}
        return self._make("std_msgs/Header", stamp=time, frame_id=frame, **seq)

    def vector(self, x: float, y: float, z: float) -> Any:
        return self._make("geometry_msgs/Vector3", x=x, y=y, z=z)

    def quaternion(self, w: float, x: float, y: float, z: float) -> Any:
        return self._make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)

    def imu(
        self,
        stamp: int,
        gyro: tuple[float, float, float] = (0.1, 0.2, 0.3),
        accel: tuple[float, float, float] = (1.0, 2.0, 9.0),
        rotor: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0),
        *,
        unreported: str = "orientation",
        frame: str = "imu_link",
    ) -> Any:
        """An Imu; ``unreported`` names the fields whose covariance begins with -1."""
        fields = ("orientation", "angular_velocity", "linear_acceleration")
        return self._make(
            "sensor_msgs/Imu",
            header=self.header(stamp, frame),
            orientation=self.quaternion(*rotor),
            angular_velocity=self.vector(*gyro),
            linear_acceleration=self.vector(*accel),
            **{
                f"{field}_covariance": covariance(-1.0 if field in unreported else 0.0)
                for field in fields
            },
        )

    def mag(
        self,
        stamp: int,
        field: tuple[float, float, float] = (1e-5, 2e-5, 3e-5),
        variance: float = 0.0,
    ) -> Any:
        return self._make(
            "sensor_msgs/MagneticField",
            header=self.header(stamp),
            magnetic_field=self.vector(*field),
            magnetic_field_covariance=covariance(variance),
        )

    def truth(
        self, kind: str, stamp: int, rotor: tuple[float, float, float, float], frame: str = "map"
    ) -> Any:
        """A message of any of the types that carry an orientation."""
        header, turn = self.header(stamp, frame), self.quaternion(*rotor)
        at = self._make("geometry_msgs/Point", x=1.0, y=2.0, z=3.0)
        pose = self._make("geometry_msgs/Pose", position=at, orientation=turn)
        name = kind.split("/")[-1]
        if name == "Imu":
            return self.imu(stamp, rotor=rotor, unreported="", frame=frame)
        if name == "QuaternionStamped":
            return self._make("geometry_msgs/QuaternionStamped", header=header, quaternion=turn)
        if name == "PoseStamped":
            return self._make("geometry_msgs/PoseStamped", header=header, pose=pose)
        if name == "TransformStamped":
            return self._make(
                "geometry_msgs/TransformStamped",
                header=header,
                child_frame_id=frame + "_child",
                transform=self._make(
                    "geometry_msgs/Transform", translation=self.vector(1.0, 2.0, 3.0), rotation=turn
                ),
            )
        twist = self._make(
            "geometry_msgs/Twist",
            linear=self.vector(4.0, 5.0, 6.0),
            angular=self.vector(7.0, 8.0, 9.0),
        )
        return self._make(
            "nav_msgs/Odometry",
            header=header,
            child_frame_id=frame + "_child",
            pose=self._make("geometry_msgs/PoseWithCovariance", pose=pose, covariance=np.ones(36)),
            twist=self._make(
                "geometry_msgs/TwistWithCovariance", twist=twist, covariance=np.ones(36)
            ),
        )
