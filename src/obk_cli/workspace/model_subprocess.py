"""A model read in a process of its own: MuJoCo is native code, which a file can bring down.

A path in; facts, or why there are none: what MuJoCo says of it, or how its process ended. The
process is forked from this one once MuJoCo is loaded, so that a model costs milliseconds more.
"""

import faulthandler
import json
import os
import resource
import signal
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Final, NoReturn

from obk_cli.config.environment import ModelFault, ModelRead
from obk_cli.workspace.mjcf_locations import mjcf_files
from obk_cli.workspace.model_reader import import_mujoco, read_model

__all__ = ["read_model_bounded"]

_CPU_S: Final = 60
_DEADLINE_S: Final = 300
"""For the process as a whole [s]: on a busy machine it waits for its turn to compute."""
_MEMORY_BYTES: Final = 4 * 1024**3


def read_model_bounded(path: Path) -> ModelRead | ModelFault:
    """As `read_model`, whatever the file makes of the process that reads it.

    Raises:
        ImportError: MuJoCo is not installed; ask `has_mujoco` first.
    """
    odd = next(filter(_is_odd, mjcf_files(path)), None)
    if odd is not None:
        return ModelFault(message=f"`{odd}` is no ordinary file")
    import_mujoco()
    here, there = os.pipe()
    with warnings.catch_warnings():
        # Threads of this process are no harm to a child that touches nothing of theirs.
        warnings.simplefilter("ignore", DeprecationWarning)
        pid = os.fork()
    if pid == 0:
        _answer(path, there)
    os.close(there)
    with os.fdopen(here, "rb") as pipe:
        output = pipe.read()
    _, status = os.waitpid(pid, 0)
    return _read_answer(output) or ModelFault(message=_end_of(os.waitstatus_to_exitcode(status)))


def _is_odd(path: Path) -> bool:
    """Whether it is there and no file: for a pipe MuJoCo would wait."""
    # The methods of `Path` raise for a name that no file can have.
    return os.path.exists(path) and not os.path.isfile(path)  # noqa: PTH110, PTH113


def _read_answer(output: bytes) -> ModelRead | ModelFault | None:
    import msgspec  # only here: a model that is in the cache needs no process

    try:
        data = json.loads(output)
        kind: type[ModelRead | ModelFault] = ModelFault if "message" in data else ModelRead
        return msgspec.convert(data, kind)
    except ValueError:  # the process ended before it could answer
        return None


def _end_of(exit_code: int) -> str:
    if exit_code == -signal.SIGXCPU:
        return f"MuJoCo wants more than {_CPU_S} s of computing to read it"
    if exit_code == -signal.SIGALRM:
        return f"MuJoCo has not read it within {_DEADLINE_S} s"
    how = signal.Signals(-exit_code).name if exit_code < 0 else f"exit code {exit_code}"
    return f"MuJoCo crashed while it read it ({how})"


def _answer(path: Path, pipe: int) -> NoReturn:
    """In the child: read, answer, end, and leave alone what belongs to the parent."""
    try:
        faulthandler.disable()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
            signal.signal(number, signal.SIG_DFL)
        signal.alarm(_DEADLINE_S)
        for what, most in ((resource.RLIMIT_CPU, _CPU_S), (resource.RLIMIT_DATA, _MEMORY_BYTES)):
            _, hard = resource.getrlimit(what)
            bound = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(what, (bound, hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        nowhere = os.open(os.devnull, os.O_RDWR)
        for output in (1, 2):
            os.dup2(nowhere, output)
        # MuJoCo would write its warnings into a file in the working directory.
        import_mujoco().set_mju_user_warning(_drop)
        with os.fdopen(pipe, "w", encoding="utf-8") as answer:
            json.dump(asdict(read_model(path)), answer)
        os._exit(0)
    finally:
        os._exit(1)


def _drop(_text: str) -> None:
    """Takes a warning of MuJoCo's and does nothing."""
