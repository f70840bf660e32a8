"""The driver alone: ``ros2 launch stateful_ahrs driver.launch.py transport:=sim``."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

CONFIG = PathJoinSubstitution([FindPackageShare("stateful_ahrs"), "config", "imu_driver.yaml"])


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="of nodes and topics"),
            DeclareLaunchArgument(
                "driver_config", default_value=CONFIG, description="parameter file of imu_driver"
            ),
            DeclareLaunchArgument(
                "transport",
                default_value="",
                description="sim, i2c or serial; empty: as in driver_config",
            ),
            OpaqueFunction(function=driver),
        ]
    )


def driver(context: LaunchContext) -> list[Node]:
    """The node, with the arguments that were given on top of its parameter file."""
    transport = LaunchConfiguration("transport").perform(context)
    return [
        Node(
            package="stateful_ahrs",
            executable="imu_driver",
            name="imu_driver",
            namespace=LaunchConfiguration("namespace"),
            parameters=[
                LaunchConfiguration("driver_config"),
                {"transport": transport} if transport else {},
            ],
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
