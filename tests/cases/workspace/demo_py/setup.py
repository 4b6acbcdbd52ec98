from setuptools import setup

setup(
    name="demo_py",
    entry_points={
        "console_scripts": [
            "broken = demo_py.broken:main",
            "callbacks = demo_py.callbacks:main",
            "computed = demo_py.computed:main",
            "controller = demo_py.controller:main",
            "estimator = demo_py.estimator:main",
            "explicit_base = demo_py.explicit_base:main",
            "gone = demo_py.gone:main",
            "keys = demo_py.keys:main",
            "long = demo_py.long:main",
            "misnamed = demo_py.controller:mian",
            "no_module = demo_py.no_module:main",
            "not_installed = demo_py.not_installed:main",
            "one_repeated = demo_py.one_repeated:main",
            "optional_imports = demo_py.optional_imports:main",
            "other_table = demo_py.other_table:main",
            "renamed = demo_py.renamed:main",
            "renamed_elsewhere = demo_py.renamed_elsewhere:main",
            "repeated = demo_py.repeated:main",
            "robot = demo_py.robot:main",
            "second = demo_py.generations:second",
            "third = demo_py.generations:third",
            "third_controller = demo_py.generations:controller",
            "tuned = demo_py.tuned:main",
            "unfinished = demo_py.unfinished:main",
            "untyped = demo_py.untyped:main",
            "without_base = demo_py.without_base:main",
            "wrong_callback = demo_py.wrong_callback:main",
            "wrong_registration = demo_py.wrong_registration:main",
            "wrong_key = demo_py.wrong_key:main",
        ]
    },
)
