from setuptools import setup

setup(name="keyed", entry_points={"console_scripts": ["controller = keyed.controller:main"]})
