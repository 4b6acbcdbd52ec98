"""OpenGL without a screen: which of MuJoCo's back ends there is, opened.

In: the environment, the libraries of this machine. Out: a context that belongs to the thread that
opened it, or an `ObeliskConfigError` that says what would help.

Source: https://mujoco.readthedocs.io/en/stable/programming/visualization.html (back ends).
"""

import importlib
import os
from collections.abc import Callable, Mapping
from ctypes.util import find_library
from typing import Any, Final

from obelisk_py.core.exceptions import ObeliskConfigError

__all__ = ["choose_back_end", "open_context"]

_LIBRARIES: Final = {"egl": "EGL", "osmesa": "OSMesa"}
"""Back end -> the library it needs, the better one first."""
_CURE: Final = (
    "`obk doctor` tells which back ends draw on this machine; `apt install libegl1 "
    "libgl1-mesa-dri` brings one that needs neither a screen nor a graphics card"
)


def choose_back_end(
    environment: Mapping[str, str] = os.environ,
    find: Callable[[str], str | None] = find_library,
) -> str:
    """The back end of MUJOCO_GL, else the first whose library is there.

    Raises:
        ObeliskConfigError: there is none, or MUJOCO_GL names one that needs a screen.
    """
    chosen = environment.get("MUJOCO_GL", "").strip().lower()
    if chosen in _LIBRARIES:
        return chosen
    if chosen:
        raise ObeliskConfigError(
            f"MUJOCO_GL is `{chosen}`, which does not draw off screen; "
            "`egl` and `osmesa` do, and without MUJOCO_GL one of them is chosen"
        )
    for back_end, library in _LIBRARIES.items():
        if find(library) is not None:
            return back_end
    raise ObeliskConfigError(
        f"cameras need OpenGL, and there is neither libEGL nor libOSMesa; {_CURE}"
    )


def open_context(
    back_end: str,
    width: int,
    height: int,
    load: Callable[[str], Any] = importlib.import_module,
) -> Any:
    """An OpenGL context for pictures of up to this size, current on this thread.

    Raises:
        ObeliskConfigError: the back end does not work.
    """
    try:
        context = load(f"mujoco.{back_end}").GLContext(width, height)
        context.make_current()
    # Each back end and driver fails with exceptions of its own, AttributeError among them.
    except Exception as error:
        raise ObeliskConfigError(
            f"cameras need OpenGL, and the back end `{back_end}` does not work: "
            f"{type(error).__name__}: {error}; {_CURE}"
        ) from error
    return context
