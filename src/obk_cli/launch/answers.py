"""How a stack is and how a transition ended, as the control socket's lines that answer.

Pure: values to bytes and back; None where a line holds no such answer.
"""

import math
from dataclasses import asdict

from obk_cli.launch.asks import ChangeAnswer, StackStatus
from obk_cli.launch.json_values import value_of
from obk_cli.launch.wire import HEARD, emit_line, parse_line

__all__ = ["emit_answer", "parse_change", "parse_status"]


def emit_answer(answer: StackStatus | ChangeAnswer | None) -> bytes:
    """The line that answers; None: the request to stop was heard."""
    match answer:
        case StackStatus():
            seconds = answer.seconds if math.isfinite(answer.seconds) else 0.0
            return emit_line({"answer": "status", **asdict(answer), "seconds": seconds})
        case ChangeAnswer():
            return emit_line({"answer": "change", **asdict(answer)})
        case None:
            return HEARD


def parse_status(line: bytes) -> StackStatus | None:
    """The stack's state in an answer; None where there is none."""
    return value_of(StackStatus, parse_line(line))


def parse_change(line: bytes) -> ChangeAnswer | None:
    """How a transition ended; a fault told by the other end is a failure; None: neither."""
    data = parse_line(line) or {}
    if isinstance(data.get("error"), str):
        return ChangeAnswer(success=False, why=data["error"])
    return value_of(ChangeAnswer, data)
