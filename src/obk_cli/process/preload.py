"""Fork Python programs from a process that has imported their libraries: the preload server.

The server runs as its own program (`python -P preload.py MODULE...`) below the warden; its standard
input is one end of a Unix socket of packets. It imports the modules, sends `{"ready": true}`, and
then takes one JSON request at a time: a file passed by descriptor, with a second descriptor for the
output. It answers with the process's `pid`, or `null` if forking would make a difference to the
program; the warden then starts it in the ordinary way. A `share` packet brings descriptors that
programs may inherit. The server ends with the warden.

A forked program is a separate process in every respect: its parent is the warden, and it has its
own session, output, environment, arguments and working folder, also in /proc. It shares the hash
seed of strings with the others. Only modules imported before the fork are shared, never user code.

The server forks only if it knows all of its threads: LTTng's listeners, which the library's own
functions stop and restart, and those of OpenBLAS, which stops and restarts them itself. This module
imports the standard library only. Source: prctl(2), PR_SET_MM_MAP; lttng-ust(3), "Daemonizing and
forking".
"""

import ctypes
import gc
import importlib
import json
import linecache
import mmap
import os
import re
import runpy
import signal
import socket
import sys
import time
import types
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from importlib.machinery import BuiltinImporter
from pathlib import Path
from typing import Any

__all__ = ["main"]

PR_SET_PDEATHSIG = 1
PR_SET_NAME = 15
PR_SET_MM = 35
PR_SET_MM_MAP = 14
PR_SET_MM_MAP_SIZE = 15
NO_EXE = 0xFFFFFFFF
POLL_S = 0.0005
LONGEST_NAME = 15
CODE_FILE = "<string>"
"""The interpreter's name for the file of `-c CODE`."""
LISTENERS = 2
"""Number of LTTng threads in each process."""
AT_START = frozenset({"sitecustomize", "usercustomize"})
"""Modules that the interpreter imports at startup, if they exist."""
USED_BY_FAST_DDS = (b"rosidl_typesupport_fastrtps_c", b"rosidl_typesupport_introspection_c")
SIGNAL_SET_BYTES = 128
LARGEST_PACKET = 64
MOST_DESCRIPTORS = 253
"""Number of descriptors in a packet that the kernel allows."""


class NoTracing:
    """LTTng is not loaded: a fork needs no preparation."""

    threads = 0

    def before(self) -> None:
        """Do nothing."""

    after_in_parent = after_in_child = before


class LttngTracing:
    """LTTng is loaded: its threads need preparation for a fork."""

    threads = LISTENERS

    def __init__(self, library: ctypes.CDLL) -> None:
        # Before version 2.13 its functions had another prefix.
        prefix = "lttng_ust" if hasattr(library, "lttng_ust_before_fork") else "ust"
        self._before = library[f"{prefix}_before_fork"]
        self._after_in_parent = library[f"{prefix}_after_fork_parent"]
        self._after_in_child = library[f"{prefix}_after_fork_child"]
        self._signals = ctypes.create_string_buffer(SIGNAL_SET_BYTES)

    def before(self) -> None:
        """Lock the library; signals are blocked until `after_...`."""
        self._before(self._signals)

    def after_in_parent(self) -> None:
        """Unlock the library."""
        self._after_in_parent(self._signals)

    def after_in_child(self) -> None:
        """Unlock the library, and start the listeners of this process."""
        self._after_in_child(self._signals)


def find_tracing() -> NoTracing | LttngTracing:
    """LTTng's functions, if an imported module has loaded it."""
    for line in Path("/proc/self/maps").read_text(encoding="utf-8").splitlines():
        path = line.partition("/")
        if re.match(r"liblttng-ust[-.](?!common|fork|tracepoint)", os.path.basename(path[2])):  # noqa: PTH119
            return LttngTracing(ctypes.CDLL(f"/{path[2]}"))
    return NoTracing()


def load_type_supports(modules: Iterable[types.ModuleType]) -> None:
    """Load what the middleware needs to know about the ROS types in these modules.

    Otherwise each process does so for every type that it uses, and each time compares the name of a
    library with those of all loaded ones. Source: rosidl_runtime_c/message_type_support_struct.h of
    ROS 2 Jazzy.
    """
    interfaces = [
        value
        for module in modules
        for value in vars(module).values()
        if hasattr(type(value), "_TYPE_SUPPORT")
    ]
    if not interfaces:
        return
    runtime = ctypes.CDLL("librosidl_runtime_c.so")
    find_message = runtime.get_message_typesupport_handle
    find_service = runtime.get_service_typesupport_handle
    for find in (find_message, find_service):
        find.restype, find.argtypes = ctypes.c_void_p, (ctypes.c_void_p, ctypes.c_char_p)
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    for interface in interfaces:
        meta: Any = type(interface)
        meta.__import_type_support__()
        if meta._TYPE_SUPPORT is None:  # nodes that need it report that
            continue
        find = find_service if hasattr(interface, "Request") else find_message
        for identifier in USED_BY_FAST_DDS:
            if not find(pointer(meta._TYPE_SUPPORT, None), identifier):
                runtime.rcutils_reset_error()


class _MemoryMap(ctypes.Structure):
    """`struct prctl_mm_map`."""

    _fields_ = (
        *((name, ctypes.c_uint64) for name in ("start_code", "end_code", "start_data", "end_data")),
        *((name, ctypes.c_uint64) for name in ("start_brk", "brk", "start_stack")),
        *((name, ctypes.c_uint64) for name in ("arg_start", "arg_end", "env_start", "env_end")),
        ("auxv", ctypes.c_void_p),
        ("auxv_size", ctypes.c_uint32),
        ("exe_fd", ctypes.c_uint32),
    )


_STAT_PLACES = {"start_code": 26, "end_code": 27, "start_stack": 28, "start_data": 45}
_STAT_PLACES |= {"end_data": 46, "start_brk": 47}
"""Field -> its number in proc_pid_stat(5)."""
_PLACE_AFTER_NAME = 3


def can_name_processes(libc: ctypes.CDLL) -> bool:
    """Whether the kernel allows a process to change its arguments and environment in /proc."""
    size = ctypes.c_uint32()
    done = libc.prctl(PR_SET_MM, PR_SET_MM_MAP_SIZE, ctypes.byref(size), 0, 0)
    return done == 0 and size.value == ctypes.sizeof(_MemoryMap)


def show_in_proc(libc: ctypes.CDLL, arguments: Iterable[str], environment: Iterable[bytes]) -> None:
    """Make /proc, and therefore `ps`, show these arguments and variables for this process.

    Raises:
        OSError: the kernel rejects the change.
    """
    shown = b"".join(os.fsencode(argument) + b"\0" for argument in arguments)
    variables = b"".join(variable + b"\0" for variable in environment)
    pages = mmap.mmap(-1, len(shown) + len(variables), flags=mmap.MAP_PRIVATE)
    pages.write(shown + variables)
    # Never unmapped: this reference is not released.
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(pages))
    start = ctypes.addressof(ctypes.c_char.from_buffer(pages))
    fields = Path("/proc/self/stat").read_bytes().rpartition(b")")[2].split()
    libc.sbrk.restype = ctypes.c_void_p
    layout = _MemoryMap(
        **{name: int(fields[place - _PLACE_AFTER_NAME]) for name, place in _STAT_PLACES.items()},
        brk=libc.sbrk(0),
        arg_start=start,
        arg_end=start + len(shown),
        env_start=start + len(shown),
        env_end=start + len(shown) + len(variables),
        exe_fd=NO_EXE,
    )
    size = ctypes.c_ulong(ctypes.sizeof(layout))
    if libc.prctl(PR_SET_MM, PR_SET_MM_MAP, ctypes.byref(layout), size, 0) != 0:
        raise OSError("the kernel rejects the memory map")


def hides_imported_modules(folders: Iterable[str]) -> bool:
    """Whether a folder shadows a module that was imported or that is imported at startup.

    A folder without `__init__.py` shadows no module.
    """
    imported = {name.partition(".")[0] for name in sys.modules} | AT_START
    for folder in folders:
        try:
            entries = list(os.scandir(folder))
        except OSError:  # the folder does not exist, so nothing is imported from it
            continue
        for entry in entries:
            if entry.is_dir() and not Path(entry.path, "__init__.py").exists():
                continue
            if entry.name.partition(".")[0] in imported:
                return True
    return False


class ForkedProgram:
    """A program in the process that was forked for it."""

    def __init__(self, request: Mapping[str, Any]) -> None:
        self._arguments: list[str] = request["arguments"]
        self._folder: str = request["folder"]
        self._variables: Mapping[str, str] = request["variables"]
        self._path: list[str] = request["path"]

    def prepare(self, libc: ctypes.CDLL, tracing: NoTracing | LttngTracing) -> None:
        """Make the process independent of the server."""
        os.chdir(self._folder)
        os.environ.update(self._variables)
        show_in_proc(libc, self._arguments, (b"%b=%b" % pair for pair in os.environb.items()))
        name = os.path.basename(self._arguments[0])[:LONGEST_NAME]  # noqa: PTH119
        libc.prctl(PR_SET_NAME, ctypes.c_char_p(os.fsencode(name)))
        tracing.after_in_child()
        gc.enable()
        if "numpy.random" in sys.modules:  # `random` reseeds itself
            sys.modules["numpy.random"].seed()
        sys.path[:] = dict.fromkeys([*map(os.path.abspath, self._path), *sys.path])
        sys.orig_argv[:] = self._arguments

    def run(self) -> None:
        """Run the program as the interpreter would: `-P -c CODE ...` or `-P -m MODULE ...`."""
        _, _, option, target, *rest = self._arguments
        sys.excepthook = _show_error
        sys.argv[:] = [option, *rest]
        main_module = types.ModuleType("__main__")
        main_module.__loader__ = BuiltinImporter
        main_module.__dict__.update(__builtins__=__builtins__, __annotations__={})
        sys.modules["__main__"] = main_module
        if option == "-m":
            run_module: Callable[[str], object] = runpy._run_module_as_main  # type: ignore[attr-defined]
            run_module(target)
        else:
            if sys.version_info >= (3, 13):  # since then, tracebacks show the lines of CODE
                linecache.cache[CODE_FILE] = (len(target), None, target.splitlines(True), CODE_FILE)
            exec(compile(target, CODE_FILE, "exec"), main_module.__dict__)  # noqa: S102 - its purpose


def _show_error(
    kind: type[BaseException], error: BaseException, trace: types.TracebackType | None
) -> None:
    """Print an error without the frames of this module."""
    while trace is not None and trace.tb_frame.f_code.co_filename == __file__:
        trace = trace.tb_next
    sys.__excepthook__(kind, error.with_traceback(trace), trace)


class Server:
    """Forks programs for the warden."""

    def __init__(
        self,
        link: socket.socket,
        inherited: Collection[int],
        libc: ctypes.CDLL,
        tracing: NoTracing | LttngTracing,
    ) -> None:
        """Create a server.

        Args:
            link: one end of the socket; the warden has the other.
            inherited: descriptors that programs may inherit.
            libc: the C library.
            tracing: the result of `find_tracing`.
        """
        self._link = link
        self._inherited = set(inherited)
        self._libc = libc
        self._tracing = tracing
        self._warden = os.getppid()

    def knows_its_threads(self) -> bool:
        """Whether only LTTng's threads remain at a fork; OpenBLAS stops its own."""
        child = self._fork()
        if child == 0:
            os._exit(0)
        os.waitpid(child, 0)
        return len(list(Path("/proc/self/task").iterdir())) == 1 + self._tracing.threads

    def serve(self) -> ForkedProgram | None:
        """Answer requests; return the program in each forked process, None once the link closes.

        Raises:
            OSError: in a forked process, if the program cannot be prepared.
        """
        while True:
            data, fds, _, _ = socket.recv_fds(self._link, LARGEST_PACKET, MOST_DESCRIPTORS)
            if not data:
                return None
            with os.fdopen(fds[0], encoding="utf-8") as file:
                request = json.load(file)
            if data == b"share":
                self._share(request, fds[1:])
                continue
            if hides_imported_modules(request["path"]):
                self._answer(None)
            elif self._fork_below_warden():
                self._take_descriptors(fds[1], request["inherited"])
                program = ForkedProgram(request)
                program.prepare(self._libc, self._tracing)
                return program
            os.close(fds[1])

    def _share(self, numbers: Sequence[int], fds: Sequence[int]) -> None:
        for fd, number in zip(fds, numbers, strict=True):
            os.dup2(fd, number)
            os.close(fd)
        self._inherited |= set(numbers)

    def _answer(self, pid: int | None) -> None:
        self._link.send(json.dumps({"pid": pid}).encode())

    def _fork(self) -> int:
        self._tracing.before()
        try:
            with warnings.catch_warnings():
                # Python warns of any thread, but the remaining ones are known.
                warnings.simplefilter("ignore", DeprecationWarning)
                child = os.fork()
        except OSError:
            self._tracing.after_in_parent()
            raise
        if child:
            self._tracing.after_in_parent()
        return child

    def _fork_below_warden(self) -> bool:
        """Fork a process whose parent becomes the warden, because its first parent ends.

        It continues once the warden has received its PID.

        Returns:
            True in that process, False in this one.
        """
        ours, theirs = socket.socketpair()
        with ours, theirs:
            try:
                middle = self._fork()
            except OSError:
                self._answer(None)
                return False
            if middle == 0:
                first_parent = _fork_and_end()
                ours.close()
                self._begin_below_warden(first_parent, theirs)
                return True
            theirs.close()
            os.waitpid(middle, 0)
            pid = ours.recv(LARGEST_PACKET)
            self._answer(int(pid) if pid else None)
            with suppress(OSError):  # it was killed in the meantime
                ours.send(b"go")
            return False

    def _begin_below_warden(self, first_parent: int, server: socket.socket) -> None:
        """Bind to the warden once it is the parent, then wait until it knows this process's PID."""
        os.setsid()
        while os.getppid() == first_parent:
            time.sleep(POLL_S)
        self._libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != self._warden:  # the warden was killed before that
            os._exit(1)
        server.send(str(os.getpid()).encode())
        if not server.recv(LARGEST_PACKET):
            os._exit(1)

    def _take_descriptors(self, output: int, inherited: Sequence[int]) -> None:
        """Keep only the program's standard descriptors and those that it inherits."""
        null = os.open(os.devnull, os.O_RDONLY)
        for own, number in ((null, 0), (output, 1), (output, 2)):
            os.dup2(own, number)
        self._link.detach()  # already closed
        for number in (null, output, *(self._inherited - set(inherited))):
            os.close(number)


def _fork_and_end() -> int:
    """Fork again and exit; returns only in the new process, with the PID of its parent."""
    this = os.getpid()
    try:
        if os.fork() == 0:
            return this
    finally:
        if os.getpid() == this:
            os._exit(0)
    raise AssertionError


def _open_descriptors() -> set[int]:
    """The open descriptors except the standard ones."""
    numbers = {int(path.name) for path in Path("/proc/self/fd").iterdir()}
    return {number for number in numbers if number > sys.stderr.fileno() and _is_open(number)}


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:  # the descriptor of the listing itself
        return False
    return True


def main(modules: Sequence[str]) -> ForkedProgram | None:
    """Import the modules and serve; return the program in each forked process."""
    gc.disable()  # until a program runs: imports leave little garbage, and collecting takes time
    inherited = _open_descriptors()
    libc = ctypes.CDLL(None)
    imported = []
    for module in modules:
        with suppress(ImportError):  # nodes that need it report that
            imported.append(importlib.import_module(module))
    load_type_supports(imported)
    link = socket.socket(fileno=sys.stdin.fileno())
    server = Server(link, inherited, libc, find_tracing())
    if not can_name_processes(libc) or not server.knows_its_threads():
        return None
    # Freeze existing objects: the garbage collector then never writes to them, so they stay shared.
    gc.freeze()
    link.send(json.dumps({"ready": True}).encode())
    return server.serve()


if __name__ == "__main__":
    _program = main(sys.argv[1:])
    if _program is not None:
        _program.run()
