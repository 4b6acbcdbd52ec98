from setuptools import setup

setup(
    name="demo_py",
    entry_points={
        "console_scripts": [
            "broken = demo_py.broken:main",
            "computed = demo_py.computed:main",
            "controller = demo_py.controller:main",
            "estimator = demo_py.estimator:main",
            "gone = demo_py.gone:main",
            "long = demo_py.long:main",
            "misnamed = demo_py.controller:mian",
            "robot = demo_py.robot:main",
            "unfinished = demo_py.unfinished:main",
        ]
    },
)
