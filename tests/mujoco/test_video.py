"""Videos of a simulation: content over time, camera selection, and reports."""

from contextlib import ExitStack
from itertools import count
from types import SimpleNamespace

import av
import mujoco
import numpy as np
import psutil
import pytest
from PIL import Image

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.cameras import CameraView, choose_back_end
from obelisk_py.core.sim.mujoco.control import ControlInbox
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.viewers.video import requested_video, video_job, video_outputs
from obelisk_spec.video import VideoStatus, read_video

from ..waiting import eventually  # noqa: TID252 - shared by folders of tests

pytestmark = pytest.mark.mujoco

SCENE = """
<mujoco model="scene">
  <option timestep="0.01" gravity="0 0 0"/>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <worldbody>
    <geom type="box" pos="0 0 0" size="3 3 0.1" rgba="1 0 0 1"/>
    <camera name="above" pos="0 0 2" resolution="64 48"/>
    <camera name="odd" pos="0 0 2" resolution="65 49"/>
    <body name="lid" pos="0 0 -5">
      <joint type="slide" axis="0 0 1"/>
      <geom type="box" size="3 3 0.1" rgba="0 0 1 1"/>
    </body>
  </worldbody>
</mujoco>
"""
RED, BLUE = 0, 2
NO_OPENGL = "cameras need OpenGL"


@pytest.fixture
def simulation():
    model = mujoco.MjModel.from_xml_string(SCENE)
    simulation = Simulation(model, ControlInbox(field="u", size=0, monotonic_s=lambda: 0.0))
    simulation.reset(None)
    return simulation


def made(simulation, path, show, *, camera="above", rate_hz=10, reported=None):
    """Record a video; return its reports, or None if this machine has no OpenGL.

    Args:
        show: called with the video; calls `seen` for each state.
        reported: receives each report immediately.
    """
    reported = [] if reported is None else reported
    settings = read_video(str(path), camera, "", rate_hz)
    with ExitStack() as closing:
        try:
            (output,) = video_outputs(
                simulation,
                settings,
                report=reported.append,
                on_close=closing.callback,
            )
        except ObeliskConfigError as error:
            rejection = str(error)
            reported.append(rejection)
            return None if NO_OPENGL in rejection else reported
        show(SimpleNamespace(begin=output.restart, seen=lambda: output.publish(None)))
    return reported


def lift(simulation, *, time_s, height):
    simulation.data.time = time_s
    simulation.data.qpos[0] = height


def colours(path):
    """The strongest channel of each frame, and the time at which it is shown [s]."""
    with av.open(path) as read:
        frames = list(read.decode(video=0))
    middles = [frame.to_ndarray(format="rgb24")[24, 32] for frame in frames]
    return [int(np.argmax(one)) for one in middles], [frame.time for frame in frames]


def test_a_video_shows_the_states_at_their_times_and_is_reported(simulation, tmp_path):
    path = tmp_path / "out.mp4"

    def show(video):
        lift(simulation, time_s=0.3, height=6.0)
        video.seen()
        # The video is closed with this one.
        lift(simulation, time_s=0.5, height=6.0)

    reported = made(simulation, path, show)
    if reported is None:
        assert not path.exists()
        return
    started, ended = reported
    assert started == VideoStatus(state="recording", path=str(path))
    assert (ended.state, ended.path) == ("finished", str(path))
    end = ended.detail
    assert ", 0.6 s, " in end
    seen, times = colours(path)
    assert (seen[0], seen[-1]) == (RED, BLUE)
    assert (times[0], times[-1]) == (0.0, pytest.approx(0.5))
    assert end.startswith(f"{len(seen)} frames, ")
    assert f" {6 - len(seen)} dropped" in end


def test_a_picture_is_the_last_state(simulation, tmp_path):
    path = tmp_path / "out.png"

    def show(video):
        lift(simulation, time_s=0.25, height=6.0)

    reported = made(simulation, path, show)
    if reported is None:
        return
    assert reported[-1] == VideoStatus(
        state="finished", path=str(path), detail="the state at 0.250 s"
    )
    with Image.open(path) as picture:
        assert picture.size == (64, 48)
        assert np.argmax(np.asarray(picture)[24, 32]) == BLUE


def test_a_robot_that_never_took_a_step_is_shown_in_its_initial_pose(simulation, tmp_path):
    reported = made(simulation, tmp_path / "out.gif", lambda video: None)
    if reported is not None:
        assert reported[-1] == VideoStatus(
            state="finished", path=str(tmp_path / "out.gif"), detail="1 frame, 0.1 s, 0 dropped"
        )


def test_after_a_reset_the_video_continues(simulation, tmp_path):
    path = tmp_path / "out.mp4"

    simulation.data.time = 7.0

    def show(video):
        lift(simulation, time_s=0.0, height=6.0)
        video.begin()

    if made(simulation, path, show) is not None:
        assert colours(path) == ([RED, BLUE], [0.0, pytest.approx(0.1)])


def test_an_existing_video_is_not_replaced(simulation, tmp_path):
    path = tmp_path / "out.png"
    path.write_text("mine")
    reported = made(simulation, path, lambda video: None)
    if reported is not None:
        assert reported[-1].path == str(tmp_path / "out-2.png")
        assert (tmp_path / "out-2.png").exists()
    assert path.read_text() == "mine"


def test_a_file_that_cannot_be_written_is_reported_immediately(simulation, tmp_path):
    def show(video):
        (drawing,) = (child for child in psutil.Process().children() if "video" in child.cmdline())
        drawing.rlimit(psutil.RLIMIT_FSIZE, (1, 1))
        frames = count()

        def is_reported():
            number = next(frames)
            lift(simulation, time_s=number / 10, height=5.5 * (number % 2))
            video.seen()
            return reported[-1].state == "failed"

        eventually(is_reported, "that the file takes no more")

    reported = []
    if made(simulation, tmp_path / "full.gif", show, reported=reported) is None:
        return
    (failed,) = reported[1:]
    assert failed.path == str(tmp_path / "full.gif")
    assert "File too large" in failed.detail
    assert list(tmp_path.iterdir()) == []


def test_a_missing_folder_is_reported_before_the_simulation_starts(simulation, tmp_path):
    path = tmp_path / "none" / "out.mp4"
    with pytest.raises(ObeliskConfigError) as caught:
        video_outputs(
            simulation,
            read_video(str(path), "above", "", 0),
            report=lambda _: None,
            on_close=lambda _: None,
        )
    assert NO_OPENGL in str(caught.value) or str(caught.value) == (
        f"{path}: No such file or directory; no video is saved"
    )


def test_a_missing_camera_is_reported_with_the_existing_ones(simulation):
    with pytest.raises(ObeliskConfigError) as caught:
        video_job(simulation.model, read_video("out.mp4", "abvoe", "", 0))
    assert str(caught.value) == ("the camera `abvoe` is not in the model; did you mean `above`?")


def test_size_and_rate_are_the_requested_ones_or_the_cameras(simulation):
    order = video_job(simulation.model, read_video("out.mp4", "above", "", 0))
    assert (order.width, order.height, order.rate_hz) == (64, 48, 30)
    order = video_job(simulation.model, read_video("out.mp4", "", "320x200", 200))
    assert order.camera is None
    # With steps of 10 ms, higher rates are not possible.
    assert (order.width, order.height, order.rate_hz) == (320, 200, 100)


def test_a_camera_with_oversized_pictures_is_reported_with_a_valid_size(simulation):
    with pytest.raises(ObeliskConfigError) as caught:
        video_job(simulation.model, read_video("out.mp4", "odd", "", 0))
    assert str(caught.value) == (
        "camera `odd`: an image of 65x49; .mp4 needs even numbers, 66x50; set `render_size`"
    )
    assert video_job(simulation.model, read_video("out.gif", "odd", "", 0)).width == 65


def test_without_a_camera_the_whole_model_is_visible(simulation):
    try:
        view = CameraView(simulation.model, None, choose_back_end(), (80, 60))
    except ObeliskConfigError as error:
        pytest.skip(str(error))
    view.update(simulation.data)
    picture = view.draw()
    view.close()
    assert picture.shape == (60, 80, 3)
    red = picture[..., RED] > 150
    assert 0.02 < red.mean() < 0.9
    edge = np.concatenate([red[0], red[-1], red[:, 0], red[:, -1]])
    assert not edge.any(), "all of the model is within the picture"


def test_parameters_without_a_file_request_no_video():
    given = {"render": "", "render_camera": "above", "render_size": "", "render_fps": 0}
    assert requested_video(given.__getitem__) is None


def test_an_impossible_video_is_an_error_of_the_parameters():
    given = {"render": "out.avi", "render_camera": "", "render_size": "", "render_fps": 0}
    with pytest.raises(ObeliskConfigError) as caught:
        requested_video(given.__getitem__)
    assert "`render`" in str(caught.value)
    assert "`out.avi`" in str(caught.value)
