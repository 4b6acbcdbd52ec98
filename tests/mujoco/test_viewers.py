"""Viewers of a simulation, as set by the node's parameters, and their update rates."""

from collections.abc import Callable
from typing import Any

import mujoco
import pytest

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.step_times import MonotonicClock
from obelisk_py.core.sim.mujoco.stepper import Stepper
from obelisk_py.core.sim.mujoco.viewers import processes
from obelisk_py.core.sim.mujoco.viewers.processes import (
    PARAMETERS,
    ViewerRequest,
    requested_viewers,
    viewer_outputs,
)

from .viewer_host import Viewable

pytestmark = pytest.mark.mujoco


def parameters(**values: str | int) -> Callable[[str], Any]:
    return lambda name: {**PARAMETERS, **values}[name]


def test_no_viewer_is_the_default() -> None:
    assert requested_viewers(parameters()) == ()


def test_only_a_web_viewer_has_a_port() -> None:
    assert requested_viewers(parameters(viewer="web")) == (
        ViewerRequest(kind="web", arguments=("0",)),
    )
    on_port = parameters(viewer="web", viewer_port=8090)
    assert requested_viewers(on_port) == (ViewerRequest(kind="web", arguments=("8090",)),)
    assert requested_viewers(parameters(viewer="native")) == (ViewerRequest(kind="native"),)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"viewer": "wbe"}, "the parameter `viewer` is `wbe`; expected one of: none, native, web"),
        (
            {"viewer": "web", "viewer_port": 70000},
            "the parameter `viewer_port` is 70000, expected a port from 1 to 65535, "
            "or 0 for a free one",
        ),
    ],
)
def test_a_value_that_means_nothing_is_rejected(values: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ObeliskConfigError) as raised:
        requested_viewers(parameters(**values))
    assert str(raised.value) == sentence


class Watching:
    """Replaces a process; records the step of each state that it receives."""

    made: "list[Watching]"

    def __init__(self, _kind: str, *rest: Any, **options: Any) -> None:
        self.data: mujoco.MjData = rest[2]
        self.states = self
        self.steps: list[int] = []
        self.is_closed = False
        self.made.append(self)

    def send(self) -> None:
        self.steps.append(round(self.data.time / 0.001))

    def close(self) -> None:
        self.is_closed = True


def test_every_viewer_gets_the_initial_state_and_then_one_every_n_steps(
    dummy: mujoco.MjModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    Watching.made = []
    monkeypatch.setattr(processes, "ViewerProcess", Watching)
    viewable = Viewable(dummy)
    simulation = viewable.simulation
    closing: list[Callable[[], None]] = []
    outputs = viewer_outputs(
        simulation,
        (ViewerRequest(kind="web", arguments=("0",)), ViewerRequest(kind="native")),
        5,
        host=viewable.host,
        on_close=closing.append,
    )
    stepper = Stepper(
        simulation,
        pace=None,
        clock=MonotonicClock(),
        outputs=outputs,
        stamp=lambda: None,
        warn=lambda _: None,
        report=lambda _: None,
    )
    simulation.reset(None)
    for _ in range(11):
        stepper.step()
    for close in closing:
        close()
    assert [(one.steps, one.is_closed) for one in Watching.made] == [([0, 5, 10], True)] * 2
