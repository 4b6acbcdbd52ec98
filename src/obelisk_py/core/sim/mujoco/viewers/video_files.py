"""Write images with frame numbers to a video file: `.mp4`, `.gif` or `.png`.

Each image is shown until the next one, so dropped frames take no space and the timing stays
correct. Memory use does not grow with the length of the video. A file appears only when it is
complete, even if the process is killed: until then it has no name, or a hidden name if the file
system does not support unnamed files. An existing file is never replaced.

Source: open(2), O_TMPFILE.
"""

import errno
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType
from typing import IO, Final, Protocol

import av
import numpy as np
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc
from numpy.typing import NDArray
from PIL import Image, ImageChops
from PIL.GifImagePlugin import getdata, getheader

__all__ = [
    "VIDEO_FILES",
    "GifFile",
    "Mp4File",
    "PngFile",
    "UnfinishedFile",
    "VideoFile",
    "free_name",
    "unfinished",
]

_GIF_TICKS_HZ: Final = 100
_LONGEST_TICKS: Final = (1 << 16) - 1
_UNKNOWN: Final = (errno.EOPNOTSUPP, errno.EISDIR)
"""Errors of file systems that do not support unnamed files."""


class VideoFile(Protocol):
    """A video that is being written."""

    def show(self, picture: NDArray[np.uint8], number: int) -> None:
        """Show an image, starting at a given frame.

        Args:
            picture: shape (height, width, 3), in the order red, green, blue, top row first.
            number: number of the frame, from 0; higher than in the previous call.
        """

    def end(self) -> None:
        """Write the remaining data; the last image is shown for one frame."""


class Mp4File:
    """H.264 in MP4, for browsers, slides and editors alike (yuv420p)."""

    def __init__(self, file: IO[bytes], size: tuple[int, int], rate_hz: int) -> None:
        """Start a video; width and height must be even."""
        self._file = av.open(file, "w", format="mp4")
        self._stream = self._file.add_stream(
            "libx264", rate_hz, options={"preset": "veryfast", "crf": "20"}
        )
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        context = self._stream.codec_context
        context.time_base = Fraction(1, rate_hz)
        # Reordered images would yield a wrong duration for a video with gaps.
        context.max_b_frames = 0
        # Encode on the rendering thread only.
        context.thread_count = 1
        # Players guess unspecified values from the size.
        context.colorspace = Colorspace.ITU709
        context.color_primaries = ColorPrimaries.BT709
        context.color_trc = ColorTrc.BT709
        context.color_range = ColorRange.MPEG

    def show(self, picture: NDArray[np.uint8], number: int) -> None:
        """Show an image, starting at a given frame."""
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24").reformat(
            format="yuv420p",
            dst_colorspace=Colorspace.ITU709,
            dst_color_range=ColorRange.MPEG,
        )
        frame.pts = number
        frame.time_base = self._stream.codec_context.time_base
        self._file.mux(self._stream.encode(frame))

    def end(self) -> None:
        """Write the encoder's remaining data, and the index."""
        self._file.mux(self._stream.encode(None))
        self._file.close()


class GifFile:
    """GIF with a palette per image; only the changed part of each image is written."""

    def __init__(self, file: IO[bytes], _size: tuple[int, int], rate_hz: int) -> None:
        """Start a video."""
        self._file = file
        self._rate_hz = rate_hz
        self._shown: Image.Image | None = None
        """The image at the latest frame."""
        self._waiting: tuple[Image.Image, tuple[int, int], int] | None = None
        """Part, corner and frame of an image that is not written yet (duration unknown)."""
        self._last = -1

    def show(self, picture: NDArray[np.uint8], number: int) -> None:
        """Show an image, starting at a given frame."""
        image = Image.fromarray(np.ascontiguousarray(picture))
        changed: tuple[int, int, int, int] | None = (0, 0, *image.size)
        if self._shown is not None:
            changed = ImageChops.difference(self._shown, image).getbbox()
        self._last = number
        self._shown = image
        if changed is None:
            return
        self._write(number)
        # The other methods lose the color of a small object on a large background.
        part = image.crop(changed).quantize(method=Image.Quantize.FASTOCTREE)
        self._waiting = part, changed[:2], number

    def end(self) -> None:
        """Write the last image."""
        self._write(self._last + 1)
        self._file.write(b";")

    def _write(self, until: int) -> None:
        """Write the waiting image, which is shown until frame `until`."""
        if self._waiting is None:
            return
        part, corner, number = self._waiting
        if self._file.tell() == 0:
            header, _ = getheader(part.copy(), info={"loop": 0})
            self._file.writelines(header)
        # Each time is rounded separately, so that errors do not accumulate.
        ticks = self._ticks(until) - self._ticks(number)
        self._file.writelines(
            getdata(
                part,
                corner,
                include_color_table=True,
                duration=min(ticks, _LONGEST_TICKS) * 1000 // _GIF_TICKS_HZ,
                disposal=1,
            )
        )

    def _ticks(self, number: int) -> int:
        """Return the start time of a frame [1/100 s]."""
        return round(number * _GIF_TICKS_HZ / self._rate_hz)


class PngFile:
    """A PNG of the last image."""

    def __init__(self, file: IO[bytes], _size: tuple[int, int], _rate_hz: int) -> None:
        """Start with no image."""
        self._file = file
        self._last: Image.Image | None = None

    def show(self, picture: NDArray[np.uint8], _number: int) -> None:
        """Replace the previous image."""
        self._last = Image.fromarray(np.ascontiguousarray(picture))

    def end(self) -> None:
        """Write the image."""
        if self._last is not None:
            self._last.save(self._file, "PNG")


VIDEO_FILES: Final[Mapping[str, Callable[[IO[bytes], tuple[int, int], int], VideoFile]]] = (
    MappingProxyType({".mp4": Mp4File, ".gif": GifFile, ".png": PngFile})
)
"""File suffix -> constructor of the video: file, width and height [pixels], frames per second."""


def free_name(path: Path) -> Path:
    """Return `path`, or if it exists, `name-2.mp4`, `name-3.mp4`, ..."""
    number, name = 1, path
    while os.path.lexists(name):
        number += 1
        name = path.with_stem(f"{path.stem}-{number}")
    return name


class UnfinishedFile:
    """A file without its final name, which `finish` sets."""

    def __init__(self, file: IO[bytes], name: Path | None) -> None:
        self.file = file
        """The file to write to."""
        self._name = name

    def finish(self, path: Path) -> Path:
        """Move the file to `path`, or to a free name if `path` exists.

        Returns:
            The final path.

        Raises:
            OSError: the file cannot be moved there.
        """
        self.file.flush()
        while True:
            free = free_name(path)
            with suppress(FileExistsError):  # created in the meantime
                self._link(free)
                return free

    def _link(self, path: Path) -> None:
        if self._name is not None:
            path.touch(exist_ok=False)  # reserves the name
            try:
                self._name.rename(path)
            except OSError:
                path.unlink()
                raise
            return
        file_fd = self.file.fileno()
        # Python follows the link in /proc only if a descriptor argument is given.
        os.link(f"/proc/self/fd/{file_fd}", path, src_dir_fd=file_fd)


@contextmanager
def unfinished(folder: Path) -> Iterator[UnfinishedFile]:
    """Open a file that `finish` moves to `folder`; removed on exit unless finished.

    Raises:
        OSError: the file cannot be created.
    """
    name = None
    try:
        file_fd = os.open(folder, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o666)
    except OSError as error:
        if error.errno not in _UNKNOWN:
            raise
        name = folder / f".video-{os.getpid()}"
        file_fd = os.open(name, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_CLOEXEC, 0o666)
    try:
        with os.fdopen(file_fd, "w+b") as file:
            yield UnfinishedFile(file, name)
    finally:
        if name is not None:
            name.unlink(missing_ok=True)
