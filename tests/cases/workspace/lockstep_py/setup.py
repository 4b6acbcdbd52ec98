from setuptools import setup

setup(
    name="lockstep_py",
    entry_points={
        "console_scripts": [
            "addresses = lockstep_py.addresses:main",
            "clocks = lockstep_py.clocks:main",
            "estimator = lockstep_py.estimator:main",
            "executors = lockstep_py.executors:main",
            "gpu = lockstep_py.gpu:main",
            "outside = lockstep_py.outside:main",
            "plain = lockstep_py.plain:main",
            "qos = lockstep_py.qos:main",
            "repeatable = lockstep_py.repeatable:main",
            "robot = lockstep_py.robot:main",
            "sets = lockstep_py.sets:main",
            "threads = lockstep_py.threads:main",
            "waiting = lockstep_py.waiting:main",
        ]
    },
)
