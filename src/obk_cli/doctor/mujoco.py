"""The `mujoco` check: step and draw a tiny scene with each OpenGL back end, in its own process."""

import os
import re
import socket
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obk_cli.doctor.child import Trial, child_command, json_output, try_program
from obk_cli.doctor.finding import Finding, error, note, ok, warning
from obk_cli.install_source import install_command
from obk_cli.optional_deps import distribution_version
from obk_cli.workspace.model_reader import has_mujoco

__all__ = [
    "DisplayFacts",
    "DrawingTrial",
    "MujocoFacts",
    "judge_display",
    "judge_mujoco",
    "probe_display",
    "probe_mujoco",
]

BACK_ENDS: Final = ("egl", "osmesa", "glfw")
_INSTALL: Final = {
    "egl": "apt install libegl1 libgl1-mesa-dri",
    "osmesa": "apt install libosmesa6",
    "glfw": "apt install libglfw3 libgl1",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawingTrial:
    """A tiny scene, stepped and drawn off-screen in its own process."""

    trial: Trial
    has_stepped: bool
    has_drawn: bool
    """Whether the image has more than one color."""
    renderer: str = ""
    """The renderer that OpenGL reports."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MujocoFacts:
    """MuJoCo, and the result of every back end."""

    version: str | None
    chosen: str
    """The user's MUJOCO_GL; empty if not set."""
    has_display: bool
    back_ends: Mapping[str, DrawingTrial]


def judge_mujoco(facts: MujocoFacts) -> Iterator[Finding]:
    """Report whether robots and their cameras can be simulated."""
    if facts.version is None:
        yield warning(
            "MuJoCo is not installed: no simulation, and models are not checked",
            install_command("sim"),
        )
        return
    if not any(tried.has_stepped for tried in facts.back_ends.values()):
        trials = [tried.trial for tried in facts.back_ends.values()]
        yield error(
            f"MuJoCo {facts.version} cannot step a tiny model: {_first_outcome(trials)}",
            "pip install --force-reinstall mujoco",
            version=facts.version,
        )
        return
    yield ok(f"MuJoCo {facts.version} steps a tiny model", version=facts.version)
    drawing = [name for name, tried in facts.back_ends.items() if tried.has_drawn]
    for name, tried in facts.back_ends.items():
        yield _judge_back_end(name, tried, facts, drawing)
    if not drawing:
        yield warning("no OpenGL back end works: cameras produce no images", _INSTALL["egl"])


def _judge_back_end(
    name: str, tried: DrawingTrial, facts: MujocoFacts, drawing: list[str]
) -> Finding:
    if tried.has_drawn:
        by = f" with {tried.renderer}" if tried.renderer else ""
        return ok(f"MUJOCO_GL={name} draws{by}", back_end=name, renderer=tried.renderer)
    result = (
        "drew an image with only one color" if tried.trial.end == "done" else tried.trial.outcome
    )
    sentence = f"MUJOCO_GL={name} {result}"
    if name == facts.chosen:
        return warning(
            f"{sentence}; this back end is selected",
            f"export MUJOCO_GL={drawing[0]}" if drawing else _INSTALL[name],
            back_end=name,
        )
    if name == "glfw" and not facts.has_display:
        return note(f"{sentence}; it needs a display", back_end=name)
    return note(sentence, _INSTALL[name], back_end=name)


def _first_outcome(trials: list[Trial]) -> str:
    return trials[0].outcome if trials else "it was not tried"


DRAW_S: Final = 20.0


def probe_mujoco() -> MujocoFacts:
    """Step and draw a tiny scene with every back end."""
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    has_display = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    trials: dict[str, DrawingTrial] = {}
    if has_mujoco():
        with ThreadPoolExecutor(len(BACK_ENDS)) as pool:
            trials = dict(zip(BACK_ENDS, pool.map(_draw, BACK_ENDS), strict=True))
    return MujocoFacts(
        version=distribution_version("mujoco") if has_mujoco() else None,
        chosen=chosen,
        has_display=has_display,
        back_ends=trials,
    )


def _draw(back_end: str) -> DrawingTrial:
    variables = {**os.environ, "MUJOCO_GL": back_end, "PYOPENGL_PLATFORM": back_end}
    if back_end == "glfw":
        del variables["PYOPENGL_PLATFORM"]
    trial = try_program(child_command("draw"), timeout_s=DRAW_S, variables=variables)
    results = json_output(trial)
    return DrawingTrial(
        trial=trial,
        has_stepped=bool(results.get("stepped")),
        has_drawn=bool(results.get("drawn")),
        renderer=str(results.get("renderer", "")),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplayFacts:
    """What DISPLAY and WAYLAND_DISPLAY name, and whether a server answers there."""

    names: tuple[str, ...]
    """Such as `DISPLAY=:0`; empty if neither is set."""
    fault: str
    """Why the first of them does not answer; empty if it does, or if none is set."""
    is_ssh: bool


def judge_display(facts: DisplayFacts) -> Iterator[Finding]:
    """Report whether a window can be opened."""
    if not facts.names:
        fix = "ssh -X ..." if facts.is_ssh else "export MUJOCO_GL=egl"
        yield note("no display is set: stacks run without windows", fix)
    elif facts.fault:
        yield note(
            f"{facts.names[0]} does not answer: {facts.fault}", "unset DISPLAY WAYLAND_DISPLAY"
        )
    else:
        yield ok(f"display {facts.names[0]} answers")


VARIABLES: Final = ("WAYLAND_DISPLAY", "DISPLAY")
ANSWER_S: Final = 1.0
_X: Final = re.compile(r"(?P<host>[^:]*):(?P<number>\d+)(?:\.\d+)?")
_X_FIRST_PORT: Final = 6000


def probe_display() -> DisplayFacts:
    """Connect to the display."""
    named = [(name, value) for name in VARIABLES if (value := os.environ.get(name))]
    faults = [_wayland_fault(v) if n == VARIABLES[0] else _x_fault(v) for n, v in named]
    return DisplayFacts(
        names=tuple(f"{name}={value}" for name, value in named),
        fault=faults[0] if faults else "",
        is_ssh="SSH_CONNECTION" in os.environ,
    )


def _wayland_fault(value: str) -> str:
    return _connect_fault(str(Path(os.environ.get("XDG_RUNTIME_DIR", "/nowhere"), value)))


def _x_fault(value: str) -> str:
    display = _X.fullmatch(value)
    if display is None:
        return "not a display name such as :0"
    number = int(display["number"])
    if display["host"] in ("", "unix"):
        return _connect_fault(f"/tmp/.X11-unix/X{number}")  # noqa: S108 - X has it there
    return _connect_fault((display["host"], _X_FIRST_PORT + number))


def _connect_fault(address: str | tuple[str, int]) -> str:
    family = socket.AF_UNIX if isinstance(address, str) else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_STREAM) as connection:
            connection.settimeout(ANSWER_S)
            connection.connect(address)
    except OSError as fault:
        return fault.strerror or str(fault)
    return ""
