"""Packaging: read by colcon, by pip and by `obk launch`."""

from setuptools import find_packages, setup

package_name = "udp_motor_robot"

setup(
    name=package_name,
    version="0.1.0",
    description="A robot node for one motor whose drive is connected over UDP.",
    maintainer="The Obelisk developers",
    license="MIT",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},  # makes `colcon test` run pytest
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "udp_motor_robot = udp_motor_robot.udp_motor_robot:main",
        ],
    },
)
