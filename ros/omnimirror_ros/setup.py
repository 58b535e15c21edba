"""Build file of the ROS 2 package, for colcon."""

from setuptools import setup

NAME = "omnimirror_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", ["config/views.toml"]),
        (f"share/{NAME}/launch", ["launch/dewarp.launch.py"]),
    ],
    install_requires=["omnimirror"],
    entry_points={"console_scripts": [f"dewarp = {NAME}.dewarp_node:main"]},
)
