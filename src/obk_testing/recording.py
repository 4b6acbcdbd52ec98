"""Write a trial as an MCAP file for `obk bag`, `obk plot` and Foxglove, and read signals back.

Times are simulated: time 0 is 1970-01-01. The simulator's states are in the topic `STATE_TOPIC`.
"""

import json
import os
import platform
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import Log

from obelisk_py.core.lockstep.scheduler import NS_PER_S
from obelisk_py.core.messages import message_name
from obelisk_py.core.serialization.codec import codec_for
from obelisk_recordings.run import open_run
from obk_cli.emit.json import emit_plan
from obk_cli.files import whole_file
from obk_cli.optional_deps import run_versions
from obk_cli.record.mcap_writer import BagWriter
from obk_cli.record.recorder import installed_definition, schema_text
from obk_testing.result import StateLog, TrialResult
from obk_testing.topic_log import Array

__all__ = ["STATE_TOPIC", "read_signals", "write_recording"]

STATE_TOPIC: Final = "/obk_test/true_state"
_ROSOUT: Final = "/rosout"
_NS: Final = 1e-9
Entry = tuple[int, int, int, bytes]
"""Time [ns], position among entries of that time, channel, bytes."""


def write_recording(path: Path, result: TrialResult, about: Mapping[str, str]) -> None:
    """Write a trial; replaces the file, unless an error occurs.

    Args:
        path: path of the file.
        result: the trial.
        about: further metadata, such as the test's name.

    Raises:
        CommandFailedError: the file cannot be written.
    """
    with whole_file(path) as temporary, BagWriter(temporary) as writer:
        writer.describe(_metadata(result, about), _attachments(result), 0)
        entries = [*_messages(writer, result), *_log(writer, result)]
        if result.states is not None:
            entries += _states(writer, result.states, len(result.t))
        entries.sort(key=lambda entry: entry[:2])
        for number, (time_ns, _, channel, data) in enumerate(entries):
            writer.add_message(channel, data, time_ns, time_ns, number)


def _metadata(result: TrialResult, about: Mapping[str, str]) -> dict[str, dict[str, str]]:
    facts = result.facts
    return {
        "obelisk": {
            "name": facts.plan.name,
            "config": str(facts.config),
            "lockstep": "true",
            "seed": str(facts.seed),
            "digest": result.digest(),
            **about,
        },
        "obelisk_versions": {**run_versions(), "numpy": np.__version__},
        "obelisk_machine": {
            "cpu": _cpu(),
            "machine": platform.machine(),
            "hash_seed": os.environ.get("PYTHONHASHSEED", "random"),
        },
    }


def _cpu() -> str:
    """Return the processor model, by which numpy, glibc and MuJoCo choose code."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, platform.processor())


def _attachments(result: TrialResult) -> dict[str, str]:
    facts = result.facts
    values: dict[str, Any] = {
        "schedule.json": facts.schedule,
        "interventions.json": [
            {"t": one.t, "duration": min(one.duration, result.duration_s - one.t), "text": one.text}
            for one in facts.interventions
        ],
        "faults.json": result.faults,
        "notes.json": result.notes,
    }
    texts = {name: json.dumps(value, indent=1) for name, value in values.items()}
    return {"plan.json": emit_plan(facts.plan), **texts}


def _messages(writer: BagWriter, result: TrialResult) -> Iterator[Entry]:
    for name, topic in result.topics.items():
        channel = _add_topic(writer, name, topic.message_class)
        for time_ns, place, data in topic.entries:
            yield time_ns, place, channel, data


def _states(writer: BagWriter, states: StateLog, count: int) -> Iterator[Entry]:
    # Only our own simulator has states, so MuJoCo is installed.
    from obelisk_py.core.robot import TrueSimState
    from obelisk_py.core.sim.mujoco.robot import StateCopy, TrueStateReader

    channel = _add_topic(writer, STATE_TOPIC, TrueSimState)
    reader, codec = TrueStateReader(states.model), _codec(TrueSimState)
    for place in range(count):
        time_ns = states.times_ns[place]
        state = StateCopy(
            stamp_ns=time_ns, qpos=states.positions[place], qvel=states.velocities[place]
        )
        yield time_ns, -1, channel, codec.pack(reader.message(state))


def _log(writer: BagWriter, result: TrialResult) -> Iterator[Entry]:
    channel = _add_topic(writer, _ROSOUT, Log)
    codec = _codec(Log)
    for place, entry in enumerate(result.log):
        seconds, nanoseconds = divmod(entry.time_ns, NS_PER_S)
        file, _, line = entry.place.rpartition(":")
        message = Log(
            stamp=Time(sec=seconds, nanosec=nanoseconds),
            level=entry.severity,
            name=entry.name,
            msg=entry.text,
            file=file,
            line=int(line),
        )
        yield entry.time_ns, place, channel, codec.pack(message)


def _add_topic(writer: BagWriter, name: str, message_class: type[Any]) -> int:
    kind = message_name(message_class)
    return writer.add_topic(name, kind, schema_text(kind, installed_definition) or "", {})


def _codec(message_class: Any) -> Any:
    codec = codec_for(message_class)
    assert codec is not None
    return codec


def read_signals(
    path: Path, fields: Iterable[str], *, positions: int | None
) -> dict[str, tuple[Array, Array]]:
    """Read times and values of some fields in a recording.

    Args:
        path: path of the file.
        fields: `TOPIC.FIELD`.
        positions: number of simulator positions to read as `qpos`; None to skip them.

    Raises:
        RecordingError: the file cannot be read, or a topic or field is missing.
    """
    run = open_run(path)
    found: dict[str, tuple[Array, Array]] = {}
    for name in fields:
        topic, _, field = name.partition(".")
        log = run[topic]
        found[name] = (log.messages.published_ns * _NS, np.array(log[field], float))
    if positions is not None:
        log = run[STATE_TOPIC]
        found["qpos"] = (log.messages.published_ns * _NS, log["y"][:, :positions])
    return found
