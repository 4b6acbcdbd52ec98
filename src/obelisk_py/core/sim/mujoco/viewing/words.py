"""What an onlooker tells the robot, which says it to the user: a severity and a sentence.

In: sentences. Out: packets of the link between both, and back.
"""

import socket
from collections.abc import Callable
from typing import Final, Literal, cast

__all__ = ["Severity", "Tell", "hear", "say"]

Severity = Literal["info", "warning"]
Tell = Callable[[Severity, str], None]
"""Takes a sentence for the user."""

_LARGEST: Final = 8192
"""Of a packet of words; what is longer is cut [bytes]."""
_SEPARATOR: Final = b":"


def say(link: socket.socket, severity: Severity, text: str) -> None:
    """Send a sentence.

    Raises:
        OSError: nobody is there any more.
    """
    link.send(severity.encode() + _SEPARATOR + text.encode()[: _LARGEST // 2])


def hear(link: socket.socket) -> tuple[Severity, str] | None:
    """Wait for a sentence; None: there will be no more."""
    try:
        packet = link.recv(_LARGEST)
    # Whoever ends with packets unread resets the link, and Linux tells so before the last words.
    except ConnectionResetError:
        packet = link.recv(_LARGEST)
    if not packet:
        return None
    severity, _, text = packet.partition(_SEPARATOR)
    return cast(Severity, severity.decode()), text.decode(errors="replace")
