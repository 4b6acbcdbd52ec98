"""Load the compiled part of message packages; a program, since a library may crash it.

Run as `python -P -m obk_cli.doctor.interfaces_program PACKAGE...`; prints a JSON object,
package -> fault, empty if it loads.
"""

import importlib
import json
import sys

__all__ = ["fault_of", "main"]


def fault_of(package: str) -> str:
    """Why a package's messages cannot be used, empty if they can."""
    try:
        importlib.import_module(f"{package}.{package}_s__rosidl_typesupport_c")
    except ImportError as error:
        return str(error)
    return ""


def main(packages: list[str]) -> None:
    """Print the fault of each package."""
    print(json.dumps({package: fault_of(package) for package in packages}))


if __name__ == "__main__":
    main(sys.argv[1:])
