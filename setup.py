"""The pip path: everything but the ROS messages and nodes, which colcon builds.

The metadata is in pyproject.toml; here is only what it cannot express: msg/, which ROS expects
at the top level, is installed into the package as `stcalib_ros.definitions`.
"""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["stcalib_ros*"]), "stcalib_ros.definitions"],
    package_dir={"stcalib_ros.definitions": "msg"},
    package_data={
        "stcalib_ros": ["py.typed", "data/**/*"],
        "stcalib_ros.definitions": ["*.msg"],
    },
)
