"""A ROS 2 package for `colcon build`; teamslam itself is installed with pip."""

from setuptools import setup

NAME = "teamslam_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    license="BSD-3-Clause",
    entry_points={"console_scripts": [f"robot = {NAME}.node:main"]},
)
