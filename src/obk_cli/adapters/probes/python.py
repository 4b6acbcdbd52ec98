"""The interpreter that runs obk."""

import sys
from pathlib import Path

import obk_cli
from obk_cli.doctor.python import PythonFacts
from obk_cli.optional_deps import distribution_version

__all__ = ["probe_python"]


def probe_python() -> PythonFacts:
    """Version, place, and whether it is an environment of its own."""
    is_conda = Path(sys.prefix, "conda-meta").is_dir()
    return PythonFacts(
        version=(sys.version_info.major, sys.version_info.minor, sys.version_info.micro),
        executable=sys.executable,
        prefix=sys.prefix,
        is_virtual=sys.prefix != sys.base_prefix or is_conda,
        obk_version=distribution_version("obelisk-cli"),
        obk_folder=str(Path(obk_cli.__file__).parent),
    )
