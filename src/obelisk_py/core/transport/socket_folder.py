"""The folder of this process's run."""

import functools
import os
from typing import Final

from rclpy.logging import get_logger

from obelisk_spec.local_transport.folder import SocketFolder
from obelisk_spec.runtime_protocol import LOCAL_TRANSPORT_OFF, LOCAL_TRANSPORT_VARIABLE

__all__ = ["socket_folder"]

_LOGGER: Final = "local_transport"


def socket_folder() -> SocketFolder | None:
    """The folder of this process's run; None: no local transport."""
    path = os.environ.get(LOCAL_TRANSPORT_VARIABLE, LOCAL_TRANSPORT_OFF)
    return None if path == LOCAL_TRANSPORT_OFF else _opened(path)


@functools.cache
def _opened(path: str) -> SocketFolder | None:
    try:
        return SocketFolder(path)
    except FileNotFoundError:  # a late restart: the run has ended
        return None
    except OSError as error:
        get_logger(_LOGGER).warning(f"no local transport, messages go through DDS: {error}")
        return None
