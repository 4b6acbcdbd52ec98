from setuptools import setup

setup(entry_points={"console_scripts": ["controller = malformed:main"]})
