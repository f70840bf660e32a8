"""The fusion alone: ``ros2 launch stateful_ahrs fusion.launch.py alpha:=0.99``."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

CONFIG = PathJoinSubstitution([FindPackageShare("stateful_ahrs"), "config", "fusion.yaml"])
PARAMETERS = {
    "alpha": (float, "weight of the gyroscope, 0 to 1"),
    "filter": (str, "name of the filter: stateful, paper, ..."),
    "world_frame": (str, "enu, nwu or ned"),
}


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="of nodes and topics"),
            DeclareLaunchArgument(
                "fusion_config", default_value=CONFIG, description="parameter file of fusion"
            ),
            *(
                DeclareLaunchArgument(
                    name,
                    default_value="",
                    description=f"{description}; empty: as in fusion_config",
                )
                for name, (_, description) in PARAMETERS.items()
            ),
            OpaqueFunction(function=fusion),
        ]
    )


def fusion(context: LaunchContext) -> list[Node]:
    """The node, with the arguments that were given on top of its parameter file."""
    alpha = LaunchConfiguration("alpha").perform(context)
    try:
        float(alpha or 0.0)
    except ValueError:
        raise RuntimeError(f"alpha must be a number between 0 and 1, got {alpha!r}.") from None
    given = {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, (kind, _) in PARAMETERS.items()
        if LaunchConfiguration(name).perform(context)
    }
    return [
        Node(
            package="stateful_ahrs",
            executable="fusion",
            name="fusion",
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("fusion_config"), given],
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
