"""Packaging: read by colcon, by pip and by `obk launch`."""

from setuptools import find_packages, setup

package_name = "quadruped_py"

setup(
    name=package_name,
    version="0.1.0",
    description="Controller and estimator of the example quadruped.",
    maintainer="The Obelisk developers",
    maintainer_email="you@example.com",
    license="MIT",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "controller = quadruped_py.controller:main",
            "estimator = quadruped_py.estimator:main",
        ],
    },
)
