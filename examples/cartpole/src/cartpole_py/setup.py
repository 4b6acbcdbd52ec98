"""Packaging: read by colcon, by pip and by `obk launch`."""

from setuptools import find_packages, setup

package_name = "cartpole_py"

setup(
    name=package_name,
    version="0.1.0",
    description="Estimator of the example cart-pole.",
    maintainer="The Obelisk developers",
    maintainer_email="you@example.com",
    license="MIT",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "estimator = cartpole_py.estimator:main",
        ],
    },
)
