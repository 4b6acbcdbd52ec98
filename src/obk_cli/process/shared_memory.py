"""Files of Fast DDS in shared memory that nobody uses any more.

A process that is killed leaves them behind, half a megabyte and more each time. Two kinds:

A segment, `fastrtps_<id>`, belongs to one process. For as long as that lives, whatever ends it, it
holds an exclusive flock on the empty file beside it, `fastrtps_<id>_el`.

A port, `fastrtps_port<number>`, belongs to all who read from it or write to it, and each of them
keeps it mapped. Beside it are the lock of its readers (`_el` or `_sl`), and the semaphore that one
holds who opens or removes it, `sem.fastrtps_port<number>_mutex`. Whether anybody has a file open or
mapped, of whatever user or container, the kernel knows: only then it refuses a write lease. And
while a lease is held whoever opens the file waits, so nobody comes in between.

Source: fcntl(2), "Leases"; Fast DDS, shared memory transport.
"""

import fcntl
import os
import re
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

__all__ = ["remove_dead_segments"]

SHARED_MEMORY: Final = Path("/dev/shm")  # noqa: S108 - where DDS has it
_LOCK: Final = re.compile(r"fastrtps_[0-9a-f]{16}_el")
_OF_PORT: Final = re.compile(
    r"(?:sem\.)?(?P<port>fastrtps_port[0-9]+)(?:|_el|_sl|_mutex)", re.ASCII
)


def remove_dead_segments(folder: Path = SHARED_MEMORY) -> int:
    """Remove segments and ports that nobody uses; gives how many there were.

    Those of other users, and of living processes, are left alone.
    """
    names = _names(folder)
    dead = [_remove_segment(folder / name) for name in names if _LOCK.fullmatch(name)]
    ports = sorted({found["port"] for name in names if (found := _OF_PORT.fullmatch(name))})
    dead += [_remove_port(folder / port) for port in ports]
    return sum(dead)


def _names(folder: Path) -> list[str]:
    try:
        return sorted(path.name for path in folder.iterdir())
    except OSError:
        return []


def _remove_segment(lock: Path) -> bool:
    segment = lock.with_name(lock.name.removesuffix("_el"))
    return _remove(flocked=(lock,), leased=(), others=(segment,))


def _remove_port(port: Path) -> bool:
    # The semaphore first and last: with its lease in hand, nobody is about to open the port.
    semaphore = port.with_name(f"sem.{port.name}_mutex")
    locks = (port.with_name(f"{port.name}_el"), port.with_name(f"{port.name}_sl"))
    return _remove(leased=(semaphore, port), flocked=locks)


def _remove(
    *, leased: tuple[Path, ...], flocked: tuple[Path, ...], others: tuple[Path, ...] = ()
) -> bool:
    """Remove files if nobody has those to be leased open, nor holds the locks; false if not so."""
    try:
        with ExitStack() as held:
            for path in leased:
                held.enter_context(_leased(path))
            for path in flocked:
                held.enter_context(_flocked(path))
            for path in (*others, *flocked, *reversed(leased)):
                path.unlink(missing_ok=True)
    except OSError:
        return False
    return True


@contextmanager
def _leased(path: Path) -> Iterator[None]:
    with _opened(path) as descriptor:
        if descriptor is not None:
            # Whoever waits for a lease has its holder signalled; the usual signal would end us.
            fcntl.fcntl(descriptor, fcntl.F_SETSIG, signal.SIGURG)
            fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_WRLCK)
        yield


@contextmanager
def _flocked(path: Path) -> Iterator[None]:
    with _opened(path) as descriptor:
        if descriptor is not None:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield


@contextmanager
def _opened(path: Path) -> Iterator[int | None]:
    """A descriptor of a file of our own, None where there is none; closed at the end.

    Raises:
        PermissionError: the file is another user's.
        OSError: somebody else has a lease of it, or it cannot be opened.
    """
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    descriptor = None
    with suppress(FileNotFoundError):
        descriptor = os.open(path, flags)
    try:
        if descriptor is not None and os.fstat(descriptor).st_uid != os.geteuid():
            raise PermissionError(f"{path} belongs to another user")
        yield descriptor
    finally:
        if descriptor is not None:
            os.close(descriptor)


if __name__ == "__main__":
    remove_dead_segments()
