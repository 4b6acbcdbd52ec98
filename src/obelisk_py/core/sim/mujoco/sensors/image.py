"""Camera images: `ObkImage`.

The input is one camera of the model. Each camera has its own rendering thread, because rendering
takes longer than a step. The sampler copies the state of the scene, and the message is passed to
`deliver` when it is rendered. In a paced simulation, an image that is due while the previous one
is still being rendered is skipped and counted. Otherwise the simulation waits for the image.
"""

import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Final

from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError
from obelisk_py.core.messages import optional_message
from obelisk_py.core.sim.mujoco.cameras import CameraView, choose_back_end
from obelisk_py.core.sim.mujoco.sensors.kind import Sampler, SensorKind, SensorSource
from obelisk_py.core.utils.msg import np_to_multiarray
from obelisk_spec.suggestions import with_number

__all__ = ["OBK_IMAGE"]

ObkImage: Any = optional_message("ObkImage")
_AXES: Final = ("height", "width", "channels")
_OPEN_S: Final = 30.0
"""Timeout for the driver to open [s]."""
_DRAW_S: Final = 30.0
"""Timeout for an image [s]."""
_REPORT_S: Final = 1.0


def _build(source: SensorSource) -> Sampler:
    feed = _Feed(source)
    source.on_close(feed.close)
    return Sampler(message=None, take=feed.sample)


class _Feed:
    """One camera and its rendering thread."""

    def __init__(self, source: SensorSource) -> None:
        (self._name,) = source.of_type("camera")
        self._source = source
        self._left_out = 0
        self._last_report_s = -float("inf")
        self._pending: Future[None] | None = None
        self._thread = ThreadPoolExecutor(1, thread_name_prefix=f"camera {self._name}")
        self._view: CameraView | None = None
        if not source.is_lockstep:
            self._view = self._open()

    def _open(self) -> CameraView:
        source, camera = self._source, self._source.model.camera(self._name).id
        try:
            opening = self._thread.submit(CameraView, source.model, camera, choose_back_end())
            return opening.result(_OPEN_S)
        except TimeoutError as error:
            self._thread.shutdown(wait=False)
            raise ObeliskConfigError(
                f"camera `{self._name}`: OpenGL did not start within {_OPEN_S:g} s"
            ) from error
        except ObeliskConfigError as error:
            self._thread.shutdown()
            raise ObeliskConfigError(f"camera `{self._name}`: {error}") from error

    def sample(self) -> None:
        """Request an image of the current state; the message has no stamp."""
        if self._pending is not None:
            if self._source.is_paced and not self._pending.done():
                self._leave_out()
                return
            self._wait_for(self._pending)
        if self._view is None:
            # Opened for the first image only, because it takes longer than a short lockstep run.
            self._view = self._open()
        self._view.update(self._source.data)
        self._pending = self._thread.submit(self._draw, self._view)
        if self._source.is_lockstep:
            self._wait_for(self._pending)

    def close(self) -> None:
        """Stop the thread after it has finished its image."""
        if self._view is not None:
            self._wait_for(self._thread.submit(self._view.close))
        self._thread.shutdown()

    def _wait_for(self, drawing: Future[None]) -> None:
        try:
            drawing.result(_DRAW_S)
        except TimeoutError as error:
            raise ObeliskError(
                f"camera `{self._name}`: OpenGL did not render an image within {_DRAW_S:g} s; "
                "`obk doctor mujoco` reports which back ends work on this machine"
            ) from error

    def _draw(self, view: CameraView) -> None:
        picture = view.draw()
        self._source.deliver(ObkImage(y=np_to_multiarray(picture, _AXES)))

    def _leave_out(self) -> None:
        self._left_out += 1
        now_s = time.monotonic()
        if now_s - self._last_report_s >= _REPORT_S:
            self._last_report_s = now_s
            self._source.warn(
                f"camera `{self._name}` cannot keep up with its `dt`: "
                f"{with_number(self._left_out, 'image')} skipped in total"
            )


OBK_IMAGE = SensorKind(message_type=ObkImage, build=_build)
"""obelisk_sensor_msgs/ObkImage: bytes in the order red, green, blue, top row first."""
