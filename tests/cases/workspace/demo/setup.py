from setuptools import setup

setup(
    name="demo",
    entry_points={
        "console_scripts": [
            "controller = demo.controller:main",
            "estimator = demo.estimator:main",
            "obelisk_mujoco_robot = demo.robot:main",
            "robot = demo.robot:main",
        ]
    },
)
