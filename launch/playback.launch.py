"""A bag into the fusion: ``ros2 launch stateful_ahrs playback.launch.py bag:=walk.mcap``."""

import shlex
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    IncludeLaunchDescription,
    OpaqueFunction,
    Shutdown,
)
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument("bag", description="rosbag2 folder, .mcap, .db3 or ROS 1 .bag"),
            DeclareLaunchArgument(
                "options",
                default_value="",
                description='of bag_player, as in options:="--rate 2 --loop"',
            ),
            IncludeLaunchDescription(str(Path(__file__).with_name("fusion.launch.py"))),
            OpaqueFunction(function=player),
        ]
    )


def player(context: LaunchContext) -> list[Node]:
    """The player; all ends with it."""
    options = LaunchConfiguration("options").perform(context)
    return [
        Node(
            package="stateful_ahrs",
            executable="bag_player",
            namespace=LaunchConfiguration("namespace"),
            arguments=[LaunchConfiguration("bag"), *shlex.split(options)],
            output="screen",
            on_exit=Shutdown(),
        )
    ]
