"""Launch the node that dewarps the images of a mirror camera."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "image": ("/camera/image_raw", "Image topic."),
    "sensor": ("paper-spherical", "Sensor file, camera file or name of a bundled sensor."),
    "views": ("", "File of views; the views of the package by default."),
    "image_transport": ("raw", "Transport of the images: raw or compressed."),
}


def generate_launch_description():
    """Return the node with its arguments."""
    package_views = PathJoinSubstitution(
        [FindPackageShare("omnimirror_ros"), "config", "views.toml"]
    )
    defaults = {name: default for name, (default, _) in ARGUMENTS.items()}
    defaults["views"] = package_views
    node = Node(
        package="omnimirror_ros",
        executable="dewarp",
        output="screen",
        parameters=[
            {name: LaunchConfiguration(name) for name in ("sensor", "views", "image_transport")}
        ],
        remappings=[("image_raw", LaunchConfiguration("image"))],
    )
    declared = [
        DeclareLaunchArgument(name, default_value=defaults[name], description=description)
        for name, (_, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, node])
