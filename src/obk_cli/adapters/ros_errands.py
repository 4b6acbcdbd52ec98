"""What a node that is there already does for others with messages, which travel as plain data.

In: a question, JSON's values, and the node's look. Out: what came of it, JSON's values:

- `{"about": "fields", "type": NAME}`: `fields`, with their types as generated packages name them.
- `{"about": "call", "service": NAME, "type": NAME, "request": DATA, "timeout_s": S}`: `response`.
- `{"about": "message", "topic": NAME, "type": NAME, "timeout_s": S}`: the next `message`; null
  where it is so long that to make data of it would hold up the node's process.
"""

from collections.abc import Mapping
from itertools import islice
from typing import Any, Final

from obk_cli.adapters.ros_calls import ServiceClient
from obk_cli.adapters.ros_listen import deserialized, serialized
from obk_cli.adapters.ros_look import RosLook
from obk_cli.adapters.ros_types import fields_of, find_type, make_message
from obk_cli.looking.fill import require_fit
from obk_cli.looking.plain_data import Plain, plain_data
from obk_cli.recording.tally import Tally

__all__ = ["run_errand"]

LONGEST_S: Final = 3600.0
"""How long whoever is to answer may be waited for [s]."""
LONGEST_MESSAGE: Final = 1 << 16
"""Of which data is made here [bytes]: some ms of Python, in which other threads hardly run."""


def run_errand(look: RosLook, question: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """What came of a question; None: it is none of these.

    Raises:
        CommandFailedError: the type is not here, or nobody answers in time.
        MisuseError: the request does not fit its type.
    """
    match question:
        case {"about": "fields", "type": str(kind)}:
            return {"fields": dict(fields_of(kind))}
        case {
            "about": "call",
            "service": str(service),
            "type": str(kind),
            "request": request,
            "timeout_s": int() | float() as wait_s,
        }:
            return {"response": _call(look, service, kind, request, min(wait_s, LONGEST_S))}
        case {
            "about": "message",
            "topic": str(topic),
            "type": str(kind),
            "timeout_s": int() | float() as wait_s,
        }:
            return {"message": _next(look, topic, kind, min(wait_s, LONGEST_S))}
    return None


def _call(look: RosLook, service: str, kind: str, request: object, timeout_s: float) -> Plain:
    asked = f"{kind}_Request"
    data = require_fit(request, asked, fields_of)
    client = ServiceClient(look, service, find_type(kind))
    return plain_data(client.call(make_message(asked, data), timeout_s))


def _next(look: RosLook, topic: str, kind: str, timeout_s: float) -> Plain:
    raw = look.listen(topic, kind, find_type(kind))
    try:
        (data,) = islice(serialized(raw, Tally(), timeout_s, each=True), 1)
    finally:
        raw.close()
    return None if len(data) > LONGEST_MESSAGE else plain_data(deserialized(data, raw))
