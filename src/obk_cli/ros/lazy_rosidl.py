"""Message packages imported without what generates them.

Each of them imports `rosidl_generator_py` for one function, and with it parser and templates, which
takes longer than all types that a node has.
"""

import importlib
import sys
from typing import Final

__all__ = ["leave_generator_for_later"]

PACKAGE: Final = "rosidl_generator_py"
GENERATOR: Final = f"{PACKAGE}.generate_py_impl"


def leave_generator_for_later() -> None:
    """Import `rosidl_generator_py` so that its generator is imported when somebody wants it.

    Does nothing where the package is imported already, or is not there.
    """
    if PACKAGE in sys.modules or GENERATOR in sys.modules:
        return
    sys.modules[GENERATOR] = None  # type: ignore[assignment]
    try:
        package = importlib.import_module(PACKAGE)
    except ImportError:  # whoever wants a message will say that there is no ROS
        return
    finally:
        del sys.modules[GENERATOR]
    package.__getattr__ = _late  # type: ignore[method-assign]


def _late(name: str) -> object:
    """What the package would have had from the start: `generate_py`."""
    if name != "generate_py":
        raise AttributeError(f"module {PACKAGE!r} has no attribute {name!r}")
    return importlib.import_module(GENERATOR).generate_py
