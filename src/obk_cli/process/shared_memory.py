"""Remove unused Fast DDS files from shared memory, and check that there is room for ROS.

A killed process leaves its files behind, at least half a megabyte each time. There are two kinds:

A segment, `fastrtps_<id>`, belongs to one process. Until that process ends, it holds an exclusive
flock on the empty file next to it, `fastrtps_<id>_el`.

A port, `fastrtps_port<number>`, belongs to all processes that read from it or write to it, and each
of them keeps it mapped. Next to it are the lock of its readers (`_el` or `_sl`) and the semaphore
that a process holds while it opens or removes the port, `sem.fastrtps_port<number>_mutex`. The
kernel refuses a write lease on a file that any process, of any user or container, has open or
mapped. While a lease is held, a process that opens the file waits, so the file stays unused until
it is removed.

The warden runs this module as a program with the standard library only.

Source: fcntl(2), "Leases"; Fast DDS, shared memory transport.
"""

import fcntl
import os
import re
import shutil
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

__all__ = ["SHARED_MEMORY", "remove_dead_segments", "require_shared_memory"]

SHARED_MEMORY: Final = Path("/dev/shm")  # noqa: S108 - where DDS keeps it
NEEDED: Final = 1 << 14
"""Room for a few pages [bytes]."""
_LOCK: Final = re.compile(r"fastrtps_[0-9a-f]{16}_el")
_OF_PORT: Final = re.compile(
    r"(?:sem\.)?(?P<port>fastrtps_port[0-9]+)(?:|_el|_sl|_mutex)", re.ASCII
)


def remove_dead_segments(folder: Path = SHARED_MEMORY) -> int:
    """Remove segments and ports that no process uses; return how many were removed.

    Files of other users and of running processes are kept.
    """
    names = _names(folder)
    dead = [_remove_segment(folder / name) for name in names if _LOCK.fullmatch(name)]
    ports = sorted({found["port"] for name in names if (found := _OF_PORT.fullmatch(name))})
    dead += [_remove_port(folder / port) for port in ports]
    return sum(dead)


def require_shared_memory(folder: Path = SHARED_MEMORY) -> None:
    """Check that there is room for ROS, which maps and writes a page of a file there when loaded.

    Without room for that page, the kernel kills the process with SIGBUS. If the memory is full,
    files that no process uses are removed first.

    Raises:
        CommandFailedError: the shared memory is full.
    """
    if _is_full(folder):
        remove_dead_segments(folder)
    if _is_full(folder):
        from obk_cli.errors import CommandFailedError

        raise CommandFailedError(
            f"{folder} is full: any process that loads ROS would crash with SIGBUS",
            help="remove files from it, or see `obk doctor shared-memory`",
        )


def _is_full(folder: Path) -> bool:
    # ROS works without shared memory if it cannot write to it at all.
    return os.access(folder, os.W_OK) and shutil.disk_usage(folder).free < NEEDED


def _names(folder: Path) -> list[str]:
    try:
        return sorted(path.name for path in folder.iterdir())
    except OSError:
        return []


def _remove_segment(lock: Path) -> bool:
    segment = lock.with_name(lock.name.removesuffix("_el"))
    return _remove(flocked=(lock,), leased=(), others=(segment,))


def _remove_port(port: Path) -> bool:
    # Lease the semaphore first, remove it last: meanwhile no process can start to open the port.
    semaphore = port.with_name(f"sem.{port.name}_mutex")
    locks = (port.with_name(f"{port.name}_el"), port.with_name(f"{port.name}_sl"))
    return _remove(leased=(semaphore, port), flocked=locks)


def _remove(
    *, leased: tuple[Path, ...], flocked: tuple[Path, ...], others: tuple[Path, ...] = ()
) -> bool:
    """Remove files unless a process has one of `leased` open or holds a lock in `flocked`."""
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
            # The kernel signals the holder when a process waits for the lease; SIGIO would kill us.
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
    """Yield a descriptor of this user's file, None if it does not exist; closed on exit.

    Raises:
        PermissionError: the file belongs to another user.
        OSError: another process holds a lease on it, or it cannot be opened.
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
