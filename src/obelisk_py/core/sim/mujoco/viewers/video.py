"""The video of a run on the robot's side: from ROS parameters to a process that draws it.

In: the node's parameters, the model. Out: an output that sends a state for each frame, and the
status of the video on `/diagnostics`. A video that cannot be made fails before anything is
simulated; if one breaks off, that is reported and the simulation goes on.
"""

import json
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import mujoco
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.node import Node

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.cameras import picture_size
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.stepper import Output
from obelisk_py.core.sim.mujoco.stepping import SampleTimes
from obelisk_py.core.sim.mujoco.viewers.processes import ViewerProcess
from obelisk_py.core.sim.mujoco.viewers.viewer_messages import Severity, VideoJob
from obelisk_spec.runtime_protocol import DIAGNOSTICS_TOPIC, rate_name
from obelisk_spec.suggestions import did_you_mean
from obelisk_spec.video import (
    VIDEO_STATUS,
    VideoError,
    VideoSettings,
    VideoStatus,
    check_video_size,
    read_video,
    video_values,
)

__all__ = ["VIDEO_PARAMETERS", "FilmDiagnostics", "requested_video", "video_job", "video_outputs"]


VIDEO_PARAMETERS: Final[Mapping[str, str | int]] = MappingProxyType(
    {"render": "", "render_camera": "", "render_size": "", "render_fps": 0}
)
"""ROS parameter -> its default, whose type it keeps."""
ReportFilm = Callable[[VideoStatus], None]
_LOSS: Final = "there is no film"
_OPEN_S: Final = 30.0
"""OpenGL that takes longer to open will not open [s]."""
_END_S: Final = 2.5
"""For the last picture and the end of the file; a node has 3 s for a transition on its way down."""
_DEPTH: Final = 10
_SENT_S: Final = 0.1
"""For the last status to reach its subscribers [s]."""


def requested_video(parameter: Callable[[str], Any]) -> VideoSettings | None:
    """The video that a node's parameters ask for; None: none.

    Args:
        parameter: gives the value of one of `VIDEO_PARAMETERS`.

    Raises:
        ObeliskConfigError: there is no such video.
    """
    path, camera, size, rate_hz = map(parameter, VIDEO_PARAMETERS)
    if not path:
        return None
    try:
        return read_video(path, camera, size, rate_hz)
    except VideoError as error:
        raise ObeliskConfigError(f"the video that `render` asks for: {error}") from error


def video_outputs(
    simulation: Simulation,
    settings: VideoSettings | None,
    *,
    report: ReportFilm,
    on_close: Callable[[Callable[[], None]], object],
) -> tuple[Output, ...]:
    """Begin a video; the output that hands it the states.

    Args:
        simulation: what is recorded.
        settings: the video; None: none.
        report: takes each change of its status; called on several threads.
        on_close: takes what has to be called when the simulation is freed.

    Raises:
        ObeliskConfigError: the camera is not there, or nothing can be drawn.
    """
    if settings is None:
        return ()
    job = video_job(simulation.model, settings)
    video = _Video(job, simulation, report)
    on_close(video.close)

    def publish(_stamp: Any) -> None:
        video.send()

    times = SampleTimes(period_s=1 / job.rate_hz, step_s=simulation.step_s)
    # The start of a run is seen too.
    return (Output(times=times, publish=publish, restart=video.send),)


def video_job(model: mujoco.MjModel, settings: VideoSettings) -> VideoJob:
    """What the process is to draw of a model.

    Raises:
        ObeliskConfigError: the camera is not there, or its pictures are of no fitting size.
    """
    camera = None if settings.camera is None else _camera(model, settings.camera)
    size = settings.size or picture_size(model, camera)
    try:
        check_video_size(settings.path.suffix, size)
    except VideoError as error:
        raise ObeliskConfigError(
            f"camera `{settings.camera}`: {error}; set `render_size`"
        ) from error
    # Between two steps there is nothing to see.
    steps_hz = int(1 / model.opt.timestep + 1e-6)
    return VideoJob(
        path=str(Path.cwd() / settings.path),
        camera=camera,
        width=size[0],
        height=size[1],
        rate_hz=max(1, min(settings.rate_hz, steps_hz)),
    )


def _camera(model: mujoco.MjModel, name: str) -> int:
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
    if number < 0:
        names = [model.camera(other).name for other in range(model.ncam)]
        hint = did_you_mean(name, filter(None, names)) or "it has none"
        raise ObeliskConfigError(f"the camera `{name}` is not in the model; {hint}")
    return int(number)


class FilmDiagnostics:
    """Publishes the status of a node's film on `/diagnostics`, where the launcher reads it."""

    def __init__(self, node: Node) -> None:
        """Make the publisher; a life-cycle publisher would be silent at configure and cleanup."""
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS_TOPIC, _DEPTH)

    def publish(self, film: VideoStatus) -> None:
        """Publish a status; may be called on any thread."""
        name = self._node.get_fully_qualified_name()
        status = DiagnosticStatus(
            level=DiagnosticStatus.ERROR if film.state == "failed" else DiagnosticStatus.OK,
            name=rate_name(name, VIDEO_STATUS),
            message=str(film),
            hardware_id=name,
            values=[KeyValue(key=key, value=value) for key, value in video_values(film)],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def close(self) -> None:
        """Remove the publisher once the last status has been sent."""
        self._publisher.wait_for_all_acked(Duration(seconds=_SENT_S))
        self._node.destroy_publisher(self._publisher)


class _Video:
    """The process that makes a video."""

    def __init__(self, job: VideoJob, simulation: Simulation, report: ReportFilm) -> None:
        """Start it, and wait until it has drawn its first image.

        Raises:
            ObeliskConfigError: it cannot draw; the sentence is its own.
        """
        self._report = report
        self._path = job.path
        self._first = Future[tuple[Severity, str]]()
        self._is_over = False
        """Whether the end of the video was reported."""
        self._viewer = ViewerProcess(
            "video",
            job.to_arguments(),
            simulation.model,
            simulation.data,
            notify=self._on_message,
            end_s=_END_S,
            loss=_LOSS,
        )
        self.send = self._viewer.states.send
        # A video has a first image, whatever comes after it.
        self.send()
        try:
            severity, text = self._first.result(_OPEN_S)
        except TimeoutError:
            severity, text = "warning", f"the video has not begun after {_OPEN_S:g} s"
        if severity == "warning":
            self._viewer.close()
            raise ObeliskConfigError(text)
        report(VideoStatus(state="recording", path=job.path))

    def close(self) -> None:
        """Finish the video with the state that was reached last."""
        self.send()
        self._viewer.close()
        if not self._is_over:
            self._fail("the video was not finished")

    def _on_message(self, severity: Severity, text: str) -> None:
        """The first message says whether the video has begun, the last one how it ended."""
        if not self._first.done():
            self._first.set_result((severity, text))
        elif severity == "warning":
            self._fail(text)
        else:
            self._is_over = True
            path, detail = json.loads(text)
            self._report(VideoStatus(state="finished", path=path, detail=detail))

    def _fail(self, reason: str) -> None:
        self._is_over = True
        detail = reason if _LOSS in reason else f"{reason}; {_LOSS}"
        self._report(VideoStatus(state="failed", path=self._path, detail=detail))
