"""What a viewer may request from the simulated robot, and what the robot reports to it, as JSON.

`read_request` checks a request of another process against the model: its type, known names, finite
numbers and ranges. The robot's reports are trusted.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import mujoco
import numpy as np

from obelisk_py.core.exceptions import ObeliskError
from obelisk_spec.suggestions import did_you_mean

__all__ = [
    "HIGHEST_SPEED",
    "LARGEST_FORCE_N",
    "LONGEST_PUSH_S",
    "LOWEST_SPEED",
    "PauseRequest",
    "PushRequest",
    "Report",
    "Request",
    "RequestError",
    "ResetRequest",
    "SpeedRequest",
    "StepRequest",
    "keyframes_of",
    "movable_bodies",
    "read_report",
    "read_request",
    "report_text",
    "request_text",
]

LARGEST_FORCE_N: Final = 10_000.0
LONGEST_PUSH_S: Final = 10.0
LOWEST_SPEED: Final = 0.01
HIGHEST_SPEED: Final = 10.0
"""Limits of the real-time factor, with `LOWEST_SPEED`."""
_KIND: Final = "request"


class RequestError(ObeliskError):
    """A request is invalid; the message says what is wrong and what would be right."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PauseRequest:
    """Pause the simulation, or continue it."""

    is_paused: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class StepRequest:
    """Take one step of a paused simulation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ResetRequest:
    """Reset the simulation."""

    keyframe: str | None
    """None for the initial state of the model."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedRequest:
    """Change the real-time factor."""

    realtime_factor: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PushRequest:
    """Push a body at its center of mass."""

    body: str
    force: tuple[float, float, float]
    """In the world frame [N]."""
    duration_s: float
    """Simulated time [s]."""

    def __str__(self) -> str:
        return f"push of {math.hypot(*self.force):.4g} N on {self.body} for {self.duration_s:g} s"


Request = PauseRequest | StepRequest | ResetRequest | SpeedRequest | PushRequest
_KINDS: Final[Mapping[str, type[Request]]] = {
    "pause": PauseRequest,
    "step": StepRequest,
    "reset": ResetRequest,
    "speed": SpeedRequest,
    "push": PushRequest,
}
_NAMES: Final = {kind: name for name, kind in _KINDS.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """The robot's state, and its answer to a request."""

    state: str
    """Label of the lifecycle state."""
    is_paused: bool
    realtime_factor: float
    """The requested factor; 0 for as fast as possible."""
    answer: str = ""
    """Empty if the report answers no request."""
    is_done: bool = True
    """Whether the request was carried out."""


def request_text(request: Request) -> str:
    """Encode a request."""
    return json.dumps({_KIND: _NAMES[type(request)], **asdict(request)})


def report_text(report: Report) -> str:
    """Encode a report."""
    return json.dumps(asdict(report))


def read_report(text: str) -> Report:
    """Decode a report of the robot."""
    return Report(**json.loads(text))


def read_request(text: str, model: mujoco.MjModel) -> Request:
    """Decode and check a request.

    Args:
        text: from the viewer.
        model: the simulated model.

    Raises:
        RequestError: the request is invalid.
    """
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RequestError("the request is not JSON") from error
    if not isinstance(data, dict):
        raise RequestError("the request is not a JSON object")
    match data.get(_KIND):
        case "pause":
            return PauseRequest(is_paused=_flag(data, "is_paused"))
        case "step":
            return StepRequest()
        case "reset":
            return ResetRequest(keyframe=_keyframe(data, model))
        case "speed":
            factor = _number(data, "realtime_factor", LOWEST_SPEED, HIGHEST_SPEED, "")
            return SpeedRequest(realtime_factor=factor)
        case "push":
            return _push(data, model)
        case kind:
            raise RequestError(f"unknown request {kind!r}; expected one of: {', '.join(_KINDS)}")


def movable_bodies(model: mujoco.MjModel) -> tuple[str, ...]:
    """The names of the bodies that can be pushed: those that joints connect to the world."""
    moving = np.flatnonzero(model.body_weldid)
    return tuple(filter(None, (model.body(int(number)).name for number in moving)))


def keyframes_of(model: mujoco.MjModel) -> tuple[str, ...]:
    """The names of a model's keyframes; those without a name cannot be chosen."""
    return tuple(filter(None, (model.key(number).name for number in range(model.nkey))))


def _push(data: Mapping[str, Any], model: mujoco.MjModel) -> PushRequest:
    body = _one_of("body", data.get("body"), movable_bodies(model))
    force = data.get("force")
    if not isinstance(force, list) or len(force) != 3:
        raise RequestError(f"`force` is {force!r}, expected three numbers [N]")
    x, y, z = (_finite("force", number) for number in force)
    size = math.hypot(x, y, z)
    if not 0 < size <= LARGEST_FORCE_N:
        raise RequestError(f"a force of {size:g} N, expected above 0, at most {LARGEST_FORCE_N:g}")
    return PushRequest(
        body=body,
        force=(x, y, z),
        duration_s=_number(data, "duration_s", 0.0, LONGEST_PUSH_S, " s"),
    )


def _keyframe(data: Mapping[str, Any], model: mujoco.MjModel) -> str | None:
    name = data.get("keyframe")
    return None if name is None else _one_of("keyframe", name, keyframes_of(model))


def _one_of(what: str, name: object, names: Sequence[str]) -> str:
    if isinstance(name, str) and name in names:
        return name
    hint = did_you_mean(str(name), names) or "it has none"
    raise RequestError(f"the model has no {what} {name!r} to choose; {hint}")


def _flag(data: Mapping[str, Any], key: str) -> bool:
    value = data.get(key)
    if not isinstance(value, bool):
        raise RequestError(f"`{key}` is {value!r}, expected true or false")
    return value


def _number(data: Mapping[str, Any], key: str, least: float, most: float, unit: str) -> float:
    """A number from `least` to `most`; a `least` of 0 is excluded."""
    value = _finite(key, data.get(key))
    if not least <= value <= most or value == 0:
        span = f"{least:g} to {most:g}" if least else f"above 0, at most {most:g}"
        raise RequestError(f"`{key}` is {value:g}, expected {span}{unit}")
    return value


def _finite(key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RequestError(f"`{key}` is {value!r}, expected a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise RequestError(f"`{key}` is {number:g}, expected a finite number")
    return number
