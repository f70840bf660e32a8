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
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

TOPICS = ("imu/data_raw", "imu/mag", "ground_truth")


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
    try:
        arguments = shlex.split(options)
    except ValueError as error:
        raise RuntimeError(f"options cannot be read ({error}): {options}") from None
    return [
        Node(
            package="stateful_ahrs",
            executable="bag_player",
            namespace=LaunchConfiguration("namespace"),
            arguments=[LaunchConfiguration("bag"), *arguments],
            # a bag's topics are absolute: these follow the namespace
            remappings=[(f"/{topic}", topic) for topic in TOPICS],
            output="screen",
            on_exit=end_all,
        )
    ]


def end_all(event: ProcessExited, context: LaunchContext) -> Shutdown | None:
    """End the launch with the node, and as an error if that failed.

    Each launch file has its own: the Python that launches need not have this package.
    """
    if context.is_shutdown:
        return None
    if event.returncode:
        raise RuntimeError(f"{event.process_name} ended with exit code {event.returncode}.")
    return Shutdown(reason=f"{event.process_name} has ended")
