"""Record a video of a run: start the process that renders it, and report its status.

An output sends a state for each frame. The status of the video is published on `/diagnostics`. If
the video cannot be started, the `configure` transition fails. If recording fails later, the failure
is reported and the simulation continues.
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
from obelisk_py.core.sim.mujoco.step_times import SampleTimes
from obelisk_py.core.sim.mujoco.stepper import TimedOutput
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

__all__ = ["VIDEO_PARAMETERS", "VideoDiagnostics", "requested_video", "video_job", "video_outputs"]


VIDEO_PARAMETERS: Final[Mapping[str, str | int]] = MappingProxyType(
    {"render": "", "render_camera": "", "render_size": "", "render_fps": 0}
)
"""ROS parameter -> its default, which sets its type."""
ReportVideo = Callable[[VideoStatus], None]
_LOSS: Final = "no video is saved"
_OPEN_S: Final = 30.0
"""Timeout for OpenGL to open [s]."""
_END_S: Final = 2.5
"""Timeout for rendering the last image and finishing the file [s]; during shutdown, a node has 3 s
for each transition."""
_DEPTH: Final = 10
_SENT_S: Final = 0.1
"""Timeout for the last status to reach its subscribers [s]."""


def requested_video(parameter: Callable[[str], Any]) -> VideoSettings | None:
    """Return the video that a node's parameters request; None if they request none.

    Args:
        parameter: returns the value of one of `VIDEO_PARAMETERS`.

    Raises:
        ObeliskConfigError: a parameter is invalid.
    """
    path, camera, size, rate_hz = map(parameter, VIDEO_PARAMETERS)
    if not path:
        return None
    try:
        return read_video(path, camera, size, rate_hz)
    except VideoError as error:
        raise ObeliskConfigError(f"the video that `render` requests: {error}") from error


def video_outputs(
    simulation: Simulation,
    settings: VideoSettings | None,
    *,
    report: ReportVideo,
    on_close: Callable[[Callable[[], None]], object],
) -> tuple[TimedOutput, ...]:
    """Start a video, and return the output that sends it the states.

    Args:
        simulation: the simulation to record.
        settings: the video; None for no video.
        report: called with each change of its status, on several threads.
        on_close: registers functions to call when the simulation is closed.

    Raises:
        ObeliskConfigError: the camera does not exist, or rendering fails.
    """
    if settings is None:
        return ()
    job = video_job(simulation.model, settings)
    video = _Video(job, simulation, report)
    on_close(video.close)

    def publish(_stamp: Any) -> None:
        video.send()

    times = SampleTimes(period_s=1 / job.rate_hz, step_s=simulation.step_s)
    # The video shows the start of a run too.
    return (TimedOutput(times=times, publish=publish, restart=video.send),)


def video_job(model: mujoco.MjModel, settings: VideoSettings) -> VideoJob:
    """Compute the arguments of the process that renders a video of a model.

    Raises:
        ObeliskConfigError: the camera does not exist, or its images have an unsupported size.
    """
    camera = None if settings.camera is None else _camera(model, settings.camera)
    size = settings.size or picture_size(model, camera)
    try:
        check_video_size(settings.path.suffix, size)
    except VideoError as error:
        raise ObeliskConfigError(
            f"camera `{settings.camera}`: {error}; set `render_size`"
        ) from error
    # The state does not change between two steps.
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


class VideoDiagnostics:
    """Publishes the status of a node's video on `/diagnostics`; the launcher subscribes to it."""

    def __init__(self, node: Node) -> None:
        """Create the publisher; a lifecycle one sends nothing in `configure` and `cleanup`."""
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS_TOPIC, _DEPTH)

    def publish(self, video: VideoStatus) -> None:
        """Publish a status; thread-safe."""
        name = self._node.get_fully_qualified_name()
        status = DiagnosticStatus(
            level=DiagnosticStatus.ERROR if video.state == "failed" else DiagnosticStatus.OK,
            name=rate_name(name, VIDEO_STATUS),
            message=str(video),
            hardware_id=name,
            values=[KeyValue(key=key, value=value) for key, value in video_values(video)],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def close(self) -> None:
        """Destroy the publisher after the last status was sent."""
        self._publisher.wait_for_all_acked(Duration(seconds=_SENT_S))
        self._node.destroy_publisher(self._publisher)


class _Video:
    """The process that records a video."""

    def __init__(self, job: VideoJob, simulation: Simulation, report: ReportVideo) -> None:
        """Start the process, and wait until it has rendered the first image.

        Raises:
            ObeliskConfigError: it cannot render; the message comes from the process.
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
        # Every video has a first image.
        self.send()
        try:
            severity, text = self._first.result(_OPEN_S)
        except TimeoutError:
            severity, text = "warning", f"the video did not start within {_OPEN_S:g} s"
        if severity == "warning":
            self._viewer.close()
            raise ObeliskConfigError(text)
        report(VideoStatus(state="recording", path=job.path))

    def close(self) -> None:
        """Finish the video with the latest state."""
        self.send()
        self._viewer.close()
        if not self._is_over:
            self._fail("the video was not finished")

    def _on_message(self, severity: Severity, text: str) -> None:
        """Handle a message: the first one reports the start of the video, the last one its end."""
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
