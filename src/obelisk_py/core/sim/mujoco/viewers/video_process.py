"""Render a video in a separate process: receive states, and write one file at the end.

Video time is simulated time. A frame that cannot be rendered in time is dropped: the previous one
is shown longer, so the video plays at the correct speed, and dropped frames are counted.

One thread renders, and another one finishes the video. The rendering thread has a lower priority
than the robot, so on a busy machine a single image may take seconds. Finishing does not wait for
it: the last image is shown until the time of the last state.
"""

import json
import os
import signal
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from math import floor
from pathlib import Path
from typing import IO, Final

import av
import mujoco
import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.exceptions import ObeliskError
from obelisk_py.core.sim.mujoco.cameras import CameraView, choose_back_end
from obelisk_py.core.sim.mujoco.viewers.priority import lower_priority
from obelisk_py.core.sim.mujoco.viewers.video_files import (
    VIDEO_FILES,
    PngFile,
    VideoFile,
    unfinished,
)
from obelisk_py.core.sim.mujoco.viewers.viewer_messages import Send, States, VideoJob

__all__ = ["FrameCounter", "VideoRecording", "run"]

_TOLERANCE: Final = 1e-6
"""Fraction of a frame by which a sum of time steps may be too low."""
_WAIT_S: Final = 1.0
_LAST_S: Final = 0.7
"""Timeout for the image that is being rendered when the video ends [s]."""
_LARGEST_SHADOW: Final = 2048
"""Side length of the shadow map [pixels]. Without a graphics card, MuJoCo's default of 4096 takes
more time than everything else, and the video does not look better."""


class FrameCounter:
    """Counts the frames of a video."""

    def __init__(self, rate_hz: int) -> None:
        """Start a video with a number of frames per second of simulated time."""
        self._rate_hz = rate_hz
        self._first = 0
        """Number of the frame at `_start_s`."""
        self._start_s: float | None = None
        self._newest_s = 0.0
        self.count = 0
        """Number of frames up to the latest state."""

    def take(self, time_s: float) -> int | None:
        """Assign a frame to a state.

        Args:
            time_s: simulated time of the state [s].

        Returns:
            The frame's number; None if the frame already has a state.
        """
        if self._start_s is None or time_s < self._newest_s:
            self._start_s, self._first = time_s, self.count
        self._newest_s = time_s
        number = self._first + floor((time_s - self._start_s) * self._rate_hz + _TOLERANCE)
        if number < self.count:
            return None
        self.count = number + 1
        return number


class VideoRecording:
    """A video from its first image to its end."""

    def __init__(self, states: States, video: VideoFile, rate_hz: int) -> None:
        """Start without an image.

        Args:
            states: must be at the first state.
            video: receives the images.
            rate_hz: frames per second of simulated time.
        """
        self._states = states
        self._video = video
        self._rate_hz = rate_hz
        self._lock = threading.Lock()
        """Protects everything below, the states and the video."""
        self._numbers = FrameCounter(rate_hz)
        self._newest: int | None = self._numbers.take(states.data.time)
        """The frame of the latest state; None once it has an image."""
        self._picture: NDArray[np.uint8] | None = None
        """The latest image."""
        self._shown = 0
        self._is_closed = False

    def draw_one(self, view: CameraView) -> None:
        """Render the latest state."""
        with self._lock:
            number = self._newest
            view.update(self._states.data)
        picture = view.draw()
        with self._lock:
            if number is not None and not self._is_closed:
                self._show(picture, number)

    def draw_all(self, view: CameraView) -> None:
        """Render new states until they are over or the video was closed."""
        while self._take(_WAIT_S):
            if self._newest is not None:
                self.draw_one(view)

    def close(self) -> str:
        """Finish the video, even during rendering, and return a summary of it."""
        with self._lock:
            self._is_closed = True
            while not self._states.is_over:
                self._receive(_WAIT_S)
            if self._newest is not None and self._picture is not None:
                self._show(self._picture, self._newest)
            self._video.end()
        count = self._numbers.count
        frames = f"{self._shown} frame{'' if self._shown == 1 else 's'}"
        return f"{frames}, {count / self._rate_hz:.1f} s, {count - self._shown} dropped"

    def _take(self, timeout_s: float) -> bool:
        """Wait for a state; false if there can be no more."""
        with self._lock:
            if self._is_closed or self._states.is_over:
                return False
            self._receive(timeout_s)
            return True

    def _receive(self, timeout_s: float) -> None:
        if self._states.take_newest(timeout_s):
            number = self._numbers.take(self._states.data.time)
            self._newest = self._newest if number is None else number

    def _show(self, picture: NDArray[np.uint8], number: int) -> None:
        self._video.show(picture, number)
        self._picture = picture
        self._newest = None
        self._shown += 1


def run(states: States, send: Send, arguments: Sequence[str]) -> None:
    """Record until no more states arrive; report the start, and the written file at the end.

    Raises:
        ObeliskError: rendering fails, or the file cannot be written.
    """
    # The process ends after the last state, and must then finish the video.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    job = VideoJob.from_arguments(arguments)
    path = Path(job.path)
    make = _picture if path.suffix == ".png" else _video
    # An OpenGL context belongs to one thread.
    thread = ThreadPoolExecutor(1, thread_name_prefix="drawing")
    view = thread.submit(_view, states.model, job).result()
    try:
        with unfinished(path.parent) as place:
            states.take_next()
            detail = make(states, view, job, place.file, thread, send)
            send("info", json.dumps([str(place.finish(path)), detail]))
    except (BrokenPipeError, ConnectionResetError):
        raise
    except (OSError, av.FFmpegError) as error:
        raise ObeliskError(f"{path}: {error.strerror or error}") from error
    # Closing OpenGL takes longer than closing a video, and is not needed here.
    os._exit(0)


def _view(model: mujoco.MjModel, job: VideoJob) -> CameraView:
    quality = model.vis.quality
    quality.shadowsize = min(quality.shadowsize, _LARGEST_SHADOW)
    return CameraView(model, job.camera, choose_back_end(), (job.width, job.height))


def _video(
    states: States,
    view: CameraView,
    job: VideoJob,
    file: IO[bytes],
    thread: ThreadPoolExecutor,
    send: Send,
) -> str:
    """Record a video of the states, and return a summary of it."""
    ending = Path(job.path).suffix
    video = VIDEO_FILES[ending](file, (job.width, job.height), job.rate_hz)
    recording = VideoRecording(states, video, job.rate_hz)
    # The first image takes longest; the simulation waits for it.
    thread.submit(recording.draw_one, view).result()
    _make_way()
    send("info", job.path)
    drawing = thread.submit(recording.draw_all, view)
    # The rendering thread only ends earlier if the file cannot be written.
    while not (states.wait_until_over(_WAIT_S) or drawing.done()):
        pass
    with suppress(TimeoutError):
        drawing.result(_LAST_S)
    return recording.close()


def _picture(
    states: States,
    view: CameraView,
    job: VideoJob,
    file: IO[bytes],
    thread: ThreadPoolExecutor,
    send: Send,
) -> str:
    """Save an image of the last state, and return a summary of it."""

    def draw() -> NDArray[np.uint8]:
        view.update(states.data)
        return view.draw()

    thread.submit(draw).result()
    send("info", job.path)
    while not states.is_over:
        states.take_newest(_WAIT_S)
    video = PngFile(file, (job.width, job.height), job.rate_hz)
    video.show(thread.submit(draw).result(), 0)
    video.end()
    return f"the state at {states.data.time:.3f} s"


def _make_way() -> None:
    """Lower the priority of every thread except the one that finishes the video.

    A lowered priority cannot be raised again, so on a busy machine that thread might never finish
    the video.
    """
    for thread in Path("/proc/self/task").iterdir():
        if int(thread.name) != threading.main_thread().native_id:
            lower_priority(int(thread.name))
