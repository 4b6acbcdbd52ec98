"""Packaging."""

from setuptools import find_packages, setup

package_name = "hazards_py"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    install_requires=["setuptools"],
    entry_points={
        "console_scripts": [
            "controller = hazards_py.controller:main",
            "drive = hazards_py.robots:drive",
            "helper = hazards_py.programs:with_helper",
            "needs_messages = hazards_py.programs:needs_messages",
            "no_spin = hazards_py.programs:without_spin",
            "simulator = hazards_py.robots:simulator",
            "waits = hazards_py.programs:waits",
        ],
    },
)
