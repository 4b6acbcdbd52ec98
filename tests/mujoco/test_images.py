"""Camera images: content, message layout, slow rendering, missing OpenGL."""

import os
import subprocess
import sys
import threading
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError
from obelisk_py.core.sim.mujoco.cameras import choose_back_end, open_context, picture_size
from obelisk_py.core.sim.mujoco.sensors import SENSOR_KINDS, SensorSource, image
from obelisk_py.core.utils.msg import multiarray_to_np

from ..waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests

pytestmark = pytest.mark.mujoco

SCENE = """
<mujoco model="scene">
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <worldbody>
    <geom type="box" pos="-1 1 0" size="1 1 0.1" rgba="1 0 0 1"/>
    <geom type="box" pos="1 1 0" size="1 1 0.1" rgba="0 1 0 1"/>
    <geom type="box" pos="0 -1 0" size="2 1 0.1" rgba="0 0 1 1"/>
    <camera name="above" pos="0 0 2" resolution="40 30"/>
    <camera name="plain" pos="0 0 2"/>
    <body name="lid" pos="0 0 -5">
      <freejoint/>
      <geom type="box" size="3 3 0.1" rgba="1 1 1 1"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def scene():
    return mujoco.MjModel.from_xml_string(SCENE)


@pytest.fixture
def feed(scene):
    """Start a camera; the result has everything that it publishes and holds."""
    closing = []
    data = mujoco.MjData(scene)
    mujoco.mj_forward(scene, data)

    def start(*, name="above", is_paced=False):
        messages, warnings = [], []
        source = SensorSource(
            model=scene,
            data=data,
            names={name: "camera"},
            rays=None,
            warn=warnings.append,
            deliver=messages.append,
            on_close=closing.append,
            is_paced=is_paced,
        )
        sampler = SENSOR_KINDS["ObkImage"].build(source)
        assert sampler.message is None
        return SimpleNamespace(take=sampler.take, messages=messages, warnings=warnings, data=data)

    start.closing = closing
    yield start
    for close in closing:
        close()


class _PaintedView:
    """A camera without OpenGL, which draws a gray level for the height of the lid."""

    def __init__(self, model, camera, back_end):
        self.may_draw = threading.Event()
        self.may_draw.set()
        self.is_closed = False
        self.grey = None
        _PaintedView.newest = self

    def update(self, data):
        self.grey = int(data.qpos[2])

    def draw(self):
        assert self.may_draw.wait(DEADLINE_S)
        return np.full((2, 2, 3), self.grey, np.uint8)

    def close(self):
        self.is_closed = True


@pytest.fixture
def painted(monkeypatch):
    monkeypatch.setattr(image, "CameraView", _PaintedView)
    monkeypatch.setattr(image, "choose_back_end", lambda: "painted")


def _greys(feed):
    return [multiarray_to_np(message.y)[0, 0, 0] for message in feed.messages]


def _opened(feed):
    """The camera, or the reason why this machine has none."""
    try:
        return feed()
    except ObeliskConfigError as error:
        return str(error)


def test_a_camera_renders_colors_in_place_or_reports_why_it_cannot(scene, feed):
    camera = _opened(feed)
    if isinstance(camera, str):
        assert camera.startswith("camera `above`: cameras need OpenGL, and ")
        assert "obk doctor" in camera
        return
    camera.take()
    camera.data.qpos[2] = 1.0
    mujoco.mj_forward(scene, camera.data)
    camera.take()
    camera.take()
    # The third one may be rendered by now; no thread waits for it.
    before, after = (multiarray_to_np(message.y) for message in camera.messages[:2])
    assert before.shape == (30, 40, 3)
    assert [dim.label for dim in camera.messages[0].y.layout.dim] == ["height", "width", "channels"]
    assert [dim.stride for dim in camera.messages[0].y.layout.dim] == [120, 3, 1]
    for place, channel in (((5, 10), 0), ((5, 30), 1), ((25, 20), 2)):
        seen = before[place].astype(int)
        assert seen[channel] > 200, (place, seen)
        assert seen.sum() - seen[channel] < 60, (place, seen)
    assert np.ptp(after[15, 20].astype(int)) < 5, "the lid is white and above the others"


DRAW = """
import sys, mujoco
model = mujoco.MjModel.from_xml_string(sys.stdin.read())
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 30, 40) as renderer:
    renderer.update_scene(data, camera="above")
    sys.stdout.buffer.write(renderer.render().tobytes())
"""
"""MuJoCo's own renderer, which reads its back end from the environment when it is imported."""


def test_a_picture_equals_that_of_mujocos_own_renderer(feed):
    camera = _opened(feed)
    if isinstance(camera, str):
        pytest.skip(camera)
    camera.take()
    feed.closing.pop()()
    (message,) = camera.messages
    drawn = subprocess.run(
        [sys.executable, "-c", DRAW],
        input=SCENE.encode(),
        stdout=subprocess.PIPE,
        env={**os.environ, "MUJOCO_GL": choose_back_end()},
        check=True,
    ).stdout
    assert multiarray_to_np(message.y).tobytes() == drawn


def test_the_resolution_of_the_model_is_the_size_of_the_picture(scene):
    assert picture_size(scene, scene.camera("above").id) == (40, 30)
    assert picture_size(scene, scene.camera("plain").id) == (640, 480)


@pytest.mark.usefixtures("painted")
def test_as_fast_as_possible_no_picture_is_left_out(feed):
    camera = feed()
    for height in range(5):
        camera.data.qpos[2] = height
        camera.take()
    feed.closing.pop()()
    assert _greys(camera) == [0, 1, 2, 3, 4]
    assert camera.warnings == []


@pytest.mark.usefixtures("painted")
def test_at_a_pace_a_picture_is_left_out_while_the_last_one_is_drawn(feed):
    camera = feed(is_paced=True)
    _PaintedView.newest.may_draw.clear()
    for height in range(1, 4):
        camera.data.qpos[2] = height
        camera.take()
    _PaintedView.newest.may_draw.set()
    feed.closing.pop()()
    assert _greys(camera) == [1]
    assert camera.warnings == [
        "camera `above` cannot keep up with its `dt`: 1 image skipped in total"
    ]


@pytest.mark.usefixtures("painted")
def test_a_closed_camera_releases_its_resources(feed):
    feed()
    before = threading.active_count()
    feed.closing.pop()()
    assert _PaintedView.newest.is_closed
    assert threading.active_count() == before - 1


def test_a_view_that_does_not_open_is_reported_with_the_camera(feed, monkeypatch):
    def refuse(model, camera, back_end):
        raise ObeliskConfigError("no OpenGL")

    monkeypatch.setattr(image, "CameraView", refuse)
    monkeypatch.setattr(image, "choose_back_end", lambda: "egl")
    before = threading.active_count()
    with pytest.raises(ObeliskConfigError, match=r"^camera `above`: no OpenGL$"):
        feed()
    assert feed.closing == []
    assert threading.active_count() == before


@pytest.mark.usefixtures("painted")
def test_a_picture_that_is_never_drawn_is_reported_with_the_camera(feed, monkeypatch):
    monkeypatch.setattr(image, "_DRAW_S", 0.01)
    camera = feed()
    _PaintedView.newest.may_draw.clear()
    camera.take()
    with pytest.raises(ObeliskError, match=r"^camera `above`: OpenGL did not render an image "):
        camera.take()
    _PaintedView.newest.may_draw.set()
    monkeypatch.undo()


def test_a_fault_while_drawing_ends_the_run(feed, painted, monkeypatch):
    def fail(self):
        raise RuntimeError("the driver is gone")

    monkeypatch.setattr(_PaintedView, "draw", fail)
    camera = feed()
    camera.take()
    with pytest.raises(RuntimeError, match="the driver is gone"):
        camera.take()


@pytest.mark.parametrize(
    ("environment", "libraries", "chosen"),
    [
        ({}, {"EGL", "OSMesa"}, "egl"),
        ({}, {"OSMesa"}, "osmesa"),
        ({"MUJOCO_GL": "osmesa"}, {"EGL"}, "osmesa"),
        ({"MUJOCO_GL": " EGL "}, set(), "egl"),
    ],
)
def test_the_back_end_is_the_users_choice_or_an_available_one(environment, libraries, chosen):
    find = {name: f"lib{name}.so" for name in libraries}.get
    assert choose_back_end(environment, find) == chosen


@pytest.mark.parametrize(
    ("environment", "part"),
    [
        ({}, "`obk doctor`"),
        ({"MUJOCO_GL": "glfw"}, "`glfw`"),
    ],
)
def test_a_missing_back_end_is_reported_with_a_hint(environment, part):
    with pytest.raises(ObeliskConfigError) as caught:
        choose_back_end(environment, lambda _: None)
    assert part in str(caught.value)


def test_a_broken_back_end_is_reported_with_its_own_message():
    def load(name):
        assert name == "mujoco.osmesa"
        raise AttributeError("'NoneType' object has no attribute 'glGetError'")

    with pytest.raises(ObeliskConfigError) as caught:
        open_context("osmesa", 4, 4, load)
    for part in ("`osmesa`", "AttributeError: 'NoneType' object", "`obk doctor`"):
        assert part in str(caught.value)
