"""Check `mujoco`: step and draw a tiny scene with each OpenGL back end, each in its own process."""

import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

from obk_cli.doctor.child import Trial, json_output, python_command, try_program
from obk_cli.doctor.finding import Finding, error, note, ok, warning
from obk_cli.optional_deps import distribution_version
from obk_cli.workspace.model_reader import has_mujoco

__all__ = ["BACK_ENDS", "DrawingTrial", "MujocoFacts", "judge_mujoco", "probe_mujoco"]


BACK_ENDS: Final = ("egl", "osmesa", "glfw")
_INSTALL: Final = {
    "egl": "apt install libegl1 libgl1-mesa-dri",
    "osmesa": "apt install libosmesa6",
    "glfw": "apt install libglfw3 libgl1",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawingTrial:
    """A tiny scene, stepped and drawn off-screen in a process of its own."""

    trial: Trial
    has_stepped: bool
    has_drawn: bool
    """Whether the picture has more than one colour."""
    renderer: str = ""
    """What drew it, as OpenGL says."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MujocoFacts:
    """MuJoCo and what became of every back end."""

    version: str | None
    chosen: str
    """MUJOCO_GL as the user has it, empty where it is not set."""
    has_display: bool
    back_ends: Mapping[str, DrawingTrial]


def judge_mujoco(facts: MujocoFacts) -> Iterator[Finding]:
    """Whether robots can be simulated, and cameras with them."""
    if facts.version is None:
        yield warning(
            "MuJoCo is not installed: no simulation, and models are not checked",
            "pip install 'obelisk-cli[sim]'",
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
    result = "drew an image of one colour" if tried.trial.end == "done" else tried.trial.outcome
    sentence = f"MUJOCO_GL={name} {result}"
    if name == facts.chosen:
        return warning(
            f"{sentence}; and it is the selected back end",
            f"export MUJOCO_GL={drawing[0]}" if drawing else _INSTALL[name],
            back_end=name,
        )
    if name == "glfw" and not facts.has_display:
        return note(f"{sentence}; it needs a display", back_end=name)
    return note(sentence, _INSTALL[name], back_end=name)


def _first_outcome(trials: list[Trial]) -> str:
    return trials[0].outcome if trials else "it was not tried"


PROGRAM: Final = "obk_cli.doctor.mujoco_program"
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
    trial = try_program(python_command(PROGRAM), timeout_s=DRAW_S, variables=variables)
    results = json_output(trial)
    return DrawingTrial(
        trial=trial,
        has_stepped=bool(results.get("stepped")),
        has_drawn=bool(results.get("drawn")),
        renderer=str(results.get("renderer", "")),
    )
