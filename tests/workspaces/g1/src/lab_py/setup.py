from glob import glob

from setuptools import find_packages, setup

package_name = "lab_py"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
        ("share/" + package_name + "/gains", glob("gains/*.yaml")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "gait_controller = lab_py.gait_controller:main",
            "joint_controller = lab_py.joint_controller:main",
            "joint_estimator = lab_py.joint_estimator:main",
            "lab_robot = lab_py.lab_robot:main",
            "lab_simulator = lab_py.lab_simulator:main",
        ],
    },
)
