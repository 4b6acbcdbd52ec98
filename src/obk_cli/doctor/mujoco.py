"""Does MuJoCo step, and can it draw pictures, with which of its back ends? Pure."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from obk_cli.doctor.finding import Finding, error, note, ok, warning
from obk_cli.doctor.trial import Trial

__all__ = ["BACK_ENDS", "DrawingTrial", "MujocoFacts", "judge_mujoco"]

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
            f"MuJoCo {facts.version} does not step a tiny model: {_first_told(trials)}",
            "pip install --force-reinstall mujoco",
            version=facts.version,
        )
        return
    yield ok(f"MuJoCo {facts.version} steps a tiny model", version=facts.version)
    drawing = [name for name, tried in facts.back_ends.items() if tried.has_drawn]
    for name, tried in facts.back_ends.items():
        yield _judge_back_end(name, tried, facts, drawing)
    if not drawing:
        yield warning("no back end of MuJoCo draws: cameras give no images", _INSTALL["egl"])


def _judge_back_end(
    name: str, tried: DrawingTrial, facts: MujocoFacts, drawing: list[str]
) -> Finding:
    if tried.has_drawn:
        by = f" with {tried.renderer}" if tried.renderer else ""
        return ok(f"MUJOCO_GL={name} draws{by}", back_end=name, renderer=tried.renderer)
    told = "drew a picture of one colour" if tried.trial.end == "done" else tried.trial.told
    sentence = f"MUJOCO_GL={name} {told}"
    if name == facts.chosen:
        return warning(
            f"{sentence}; it is the one that is chosen",
            f"export MUJOCO_GL={drawing[0]}" if drawing else _INSTALL[name],
            back_end=name,
        )
    if name == "glfw" and not facts.has_display:
        return note(f"{sentence}; it needs a display", back_end=name)
    return note(sentence, _INSTALL[name], back_end=name)


def _first_told(trials: list[Trial]) -> str:
    return trials[0].told if trials else "it was not tried"
