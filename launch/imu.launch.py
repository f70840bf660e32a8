"""Driver and fusion, with the arguments of both: ``ros2 launch stateful_ahrs imu.launch.py``."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        IncludeLaunchDescription(str(Path(__file__).with_name(file)))
        for file in ("fusion.launch.py", "driver.launch.py")  # a wrong alpha starts neither
    )
