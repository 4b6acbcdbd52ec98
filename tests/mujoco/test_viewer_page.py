"""The page of a simulation in a browser: its controls reach the simulation and show its answers."""

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import mujoco
import pytest

from obelisk_py.core.sim.mujoco.step_queue import StepQueue
from obelisk_py.core.sim.mujoco.viewers.processes import ViewerProcess
from obelisk_py.core.sim.mujoco.viewers.web_commands import command_units, commands_table

from ..browser import chromium, opened, seen  # noqa: TID252 - shared by folders of tests
from ..waiting import eventually  # noqa: TID252 - shared by folders of tests
from .viewer_host import Viewable

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = [pytest.mark.mujoco, pytest.mark.browser, pytest.mark.timeout(600)]

SHORT_S = 0.01
DRIVES = """
<mujoco>
  <worldbody>
    <body name="a"><joint name="turn"/><geom size="0.1"/>
      <body name="b"><joint name="slide" type="slide"/><geom size="0.1"/></body>
    </body>
  </worldbody>
  <tendon><fixed name="both"><joint joint="turn" coef="1"/></fixed></tendon>
  <actuator>
    <motor name="torque" joint="turn"/>
    <motor name="force" joint="slide" ctrllimited="true" ctrlrange="-1 1"/>
    <position name="angle" joint="turn" kp="7" kv="1"/>
    <position name="place" joint="slide"/>
    <velocity name="rate" joint="turn" kv="3"/>
    <general joint="turn" gainprm="5"/>
    <motor name="&lt;tendon&gt;" tendon="both"/>
  </actuator>
</mujoco>
"""


@contextmanager
def shown(viewable: Viewable) -> Iterator[ViewerProcess]:
    """A viewer of a simulation that steps in a thread, as the robot does."""
    viewable.queue = StepQueue(is_stepping=lambda: viewable.state == "active")
    viewable.controls = replace(viewable.controls, queue=viewable.queue)
    host = replace(viewable.host, controls=viewable.controls)
    data = viewable.simulation.data
    viewer = ViewerProcess("web", ("0", "arm"), viewable.model, data, notify=print, host=host)
    is_over = threading.Event()

    def step() -> None:
        while not is_over.wait(SHORT_S):
            viewable.queue.run_pending()
            if viewable.state == "active" and not viewable.queue.is_paused:
                viewable.simulation.advance()
            viewer.states.send()

    stepping = threading.Thread(target=step)
    stepping.start()
    try:
        yield viewer
    finally:
        is_over.set()
        stepping.join()
        viewer.close()


def status(page: "Page") -> str:
    return page.locator("strong", has_text=re.compile("ing|Paused")).locator("..").inner_text()


def time_s(page: "Page") -> float:
    return float(re.findall(r"time ([\d.]+) s", status(page))[0])


def test_the_controls_of_the_page_act_and_show_the_result(dummy: mujoco.MjModel) -> None:
    chromium()
    pytest.importorskip("mjviser")
    viewable = Viewable(dummy, state="inactive")
    simulation, log = viewable.simulation, viewable.log
    with shown(viewable):
        eventually(lambda: viewable.pages, "the link")
        with opened(viewable.pages[0], width=900, height=900, needs_webgl=True) as page:

            def button(name: str) -> object:
                return page.get_by_role("button", name=name, exact=True)

            seen(lambda: "inactive" in status(page), "why nothing can be done")
            assert page.title() == "dummy - obk"
            assert "token" not in page.url
            assert button("Pause").is_disabled()

            viewable.state = "active"
            seen(lambda: "Running" in status(page) and time_s(page) > 0, "that it runs")
            button("Pause").click()
            seen(lambda: "Paused" in status(page), "the pause")
            steps = simulation.steps
            seen(lambda: time_s(page) == pytest.approx(simulation.data.time), "the paused time")
            button("Step").click()
            seen(lambda: simulation.steps == steps + 1, "the step")
            seen(lambda: time_s(page) == pytest.approx(simulation.data.time), "the time after it")

            button("Reset").click()
            seen(lambda: time_s(page) == 0.0, "the reset")
            button("Push").click()
            seen(lambda: "push of 6 N on link1 for 0.1 s" in status(page), "the push")
            button("Step").click()
            seen(lambda: simulation.data.xfrc_applied.any(), "its force")

            page.get_by_role("checkbox", name="Show", exact=True).check()
            seen(lambda: page.get_by_text("joint1_position").is_visible(), "the commands")
            simulation.data.ctrl[0] = 0.123
            seen(lambda: page.get_by_text("0.123").is_visible(), "the new command")

            button("Continue").click()
            seen(lambda: time_s(page) > 0.05, "that it continues")
    texts = [line.partition(" from the viewer")[0] for line in log]
    assert texts == [
        "simulation paused",
        "one step",
        "reset to the keyframe ic",
        "push of 6 N on link1 for 0.1 s",
        "one step",
        "simulation continued",
    ]


def test_commands_have_the_units_of_their_joints_and_force_laws() -> None:
    model = mujoco.MjModel.from_xml_string(DRIVES)
    assert command_units(model) == ("N m", "N", "rad", "m", "rad/s", "", "")


def test_commands_are_in_the_order_of_the_model_and_show_what_limits_them() -> None:
    model = mujoco.MjModel.from_xml_string(DRIVES)
    data = mujoco.MjData(model)
    data.ctrl[:] = [0.5, -3.0, 0.25, 0, 0, 0, 0]
    table = commands_table(model, data, command_units(model))
    rows = [re.sub("<[^>]*>", " ", row).split() for row in table.split("</tr>")[1:]]
    assert rows[0] == ["torque", "0.500", "N", "m"]
    assert rows[1] == ["force", "-3.000,", "limited", "to", "-1.000", "N"]
    assert rows[2] == ["angle", "0.250", "rad"]
    assert rows[5][:2] == ["actuator", "5"]
    assert "&lt;tendon&gt;" in table


def test_the_view_frames_what_moves_and_not_the_ground() -> None:
    pytest.importorskip("mjviser")
    from obelisk_py.core.sim.mujoco.viewers.web_camera import moving_box

    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody>
          <geom type="plane" size="100 100 1"/><geom size="1" pos="50 0 0"/>
          <body pos="3 0 1"><freejoint/><geom size="0.5"/><geom size="0.1" pos="0 1 0"/></body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    low, high = moving_box(model, data)
    assert low.tolist() == pytest.approx([2.5, -0.5, 0.5])
    assert high.tolist() == pytest.approx([3.5, 1.1, 1.5])
    fixed = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"
    )
    low, high = moving_box(fixed, mujoco.MjData(fixed))
    assert (high > low).all()
