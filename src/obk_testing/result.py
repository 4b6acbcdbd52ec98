"""The results of a run: messages with times, states after every step, faults and logs.

`run["/arm/est"].q_joints` is an array with one row per message. `run.qpos` has one row per step of
the simulator.
"""

import hashlib
import struct
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from obelisk_py.core.lockstep.interception import LogEntry
from obelisk_py.core.lockstep.scheduler import NS_PER_S
from obelisk_py.core.lockstep.topics import Topic
from obelisk_recordings.bag import RecordingError
from obelisk_spec.suggestions import did_you_mean
from obk_cli.plan.plan import Plan
from obk_testing.topic_log import Array, TopicLog

__all__ = ["Intervention", "StateLog", "TrialFacts", "TrialResult"]

__tracebackhide__ = True
"""Makes pytest show the line in the test instead of lines in this module."""

_FIRST: Final = -1
"""Position of a state: steps come before messages of the same time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Intervention:
    """An action of a test on the stack."""

    t: float
    """When [s]."""
    duration: float
    """How long [s]; 0 if instantaneous, infinite if until the end."""
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialFacts:
    """The setup of a trial, and the test's actions."""

    config: Path
    plan: Plan
    seed: int = 0
    schedule: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the schedule."""
    interventions: tuple[Intervention, ...] = ()
    looked_at: dict[tuple[str, ...], None] = field(default_factory=dict)
    """The arrays that the test read, in order: (topic, field), (`qpos`,), (`joint`, name)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Whether two runs agree within a tolerance; true in a condition if they do."""

    difference: str | None
    """The largest difference beyond the tolerance, as a sentence; None if they agree."""

    def __bool__(self) -> bool:
        return self.difference is None

    def __repr__(self) -> str:
        return self.difference or "the runs agree"


class StateLog:
    """The states of a simulator after every step."""

    def __init__(self, robot: str, model: Any) -> None:
        """Start without states.

        Args:
            robot: full name of its node.
            model: the MuJoCo model.
        """
        self.robot = robot
        self.model = model
        self.joints = joints_of(model)
        """Joints with one position: name -> index in qpos."""
        self.times_ns: list[int] = []
        self.positions: list[Array] = []
        self.velocities: list[Array] = []

    def add(self, time_ns: int, qpos: Array, qvel: Array) -> None:
        """Store copies of the positions and velocities at a time [ns]."""
        self.times_ns.append(time_ns)
        self.positions.append(qpos.copy())
        self.velocities.append(qvel.copy())


class TrialResult:
    """The results of a trial up to a time."""

    def __init__(
        self,
        *,
        facts: TrialFacts,
        duration_s: float,
        topics: Mapping[str, Topic],
        states: StateLog | None,
        faults: Sequence[str],
        notes: Sequence[str],
        log: Sequence[LogEntry],
        ways: Mapping[str, str],
    ) -> None:
        """Build the result from the data that a trial has collected.

        Args:
            facts: the setup of the trial.
            duration_s: simulated time [s].
            topics: topics by full name.
            states: states of the simulator; None if there is none.
            faults: faults of nodes and robots that reject all commands, as sentences.
            notes: notes from the scheduler.
            log: log messages of the nodes.
            ways: why a topic of the config has no messages, by full name.
        """
        self.facts = facts
        self.duration_s = duration_s
        self.topics = {
            name: TopicLog.of(topic, self._note_look, ways.get(name))
            for name, topic in topics.items()
            if topic.log is not None
        }
        """The recorded topics by full name."""
        self.faults = tuple(faults)
        """Faults of nodes, as in the log, and robots that have rejected all commands for 1 s."""
        self.notes = tuple(notes)
        """The scheduler's notes about anything that takes time or is not in lockstep."""
        self.log = tuple(log)
        """Log messages of the nodes."""
        self.states = states
        """States of the simulator; more may be added after this result."""
        self._ways = ways
        self._count = len(states.times_ns) if states else 0

    def __repr__(self) -> str:
        return f"<{self.duration_s:g} s of {self.facts.plan.name}, seed {self.seed}>"

    @property
    def seed(self) -> int:
        """The seed of the trial."""
        return self.facts.seed

    def __getitem__(self, topic: str) -> TopicLog:
        if topic in self.topics:
            return self.topics[topic]
        if topic in self._ways:
            raise LookupError(self._ways[topic])
        help = did_you_mean(topic, self.topics) or f"topics: {', '.join(sorted(self.topics))}"
        raise LookupError(f"no topic `{topic}`: {help}")

    @cached_property
    def t(self) -> Array:
        """Times of the states [s], shape `(n,)`."""
        return np.array(self._require_states().times_ns[: self._count], dtype=np.int64) / NS_PER_S

    @property
    def qpos(self) -> Array:
        """Positions after each step, shape `(n, nq)`."""
        self._note_look(("qpos",))
        return self._qpos

    @property
    def qvel(self) -> Array:
        """Velocities after each step, shape `(n, nv)`."""
        self._note_look(("qvel",))
        return self._qvel

    @cached_property
    def _qpos(self) -> Array:
        return np.array(self._require_states().positions[: self._count])

    @cached_property
    def _qvel(self) -> Array:
        return np.array(self._require_states().velocities[: self._count])

    def joint(self, name: str) -> Array:
        """Position of a hinge or slide joint after each step, shape `(n,)`.

        Raises:
            LookupError: the model has no such joint.
        """
        joints = self._require_states().joints
        if name not in joints:
            help = did_you_mean(name, joints) or f"it has {', '.join(joints)}"
            raise LookupError(f"the model has no joint `{name}`: {help}")
        self._note_look(("joint", name))
        column: Array = self._qpos[:, joints[name]]
        return column

    def digest(self, topics: Iterable[str] | None = None) -> str:
        """Compute the SHA-256 of every state and every message, with their times.

        Args:
            topics: only these topics; None for all recorded ones.
        """
        digest = hashlib.sha256()
        if self.states is not None:
            for place in range(self._count):
                digest.update(self.states.times_ns[place].to_bytes(8, "little"))
                digest.update(self.states.positions[place].tobytes())
                digest.update(self.states.velocities[place].tobytes())
        for name in sorted(self.topics if topics is None else topics):
            digest.update(name.encode())
            for sent_ns, _, data in self[name].entries:
                digest.update(sent_ns.to_bytes(8, "little"))
                digest.update(data)
        return digest.hexdigest()

    def first_difference(self, other: "TrialResult") -> str | None:
        """Describe where two runs first differ; None if they are bitwise equal."""
        found = sorted([*self._state_differences(other), *self._message_differences(other)])
        return f"{found[0][0] / NS_PER_S:.6f} s: {found[0][2]}" if found else None

    def close_to(
        self, other: "TrialResult | str | Path", *, atol: float, fields: Iterable[str] = ()
    ) -> Comparison:
        """Compare the simulator's positions with those of another run.

        Args:
            other: a run, or an MCAP file written by `obk test --keep-all`.
            atol: maximum difference [unit of the positions and fields].
            fields: `TOPIC.FIELD` to compare too, message by message, such as `/arm/est.q_joints`.

        Returns:
            True in a condition if they agree; otherwise displayed as the largest difference.

        Raises:
            LookupError: a run lacks a field or the states, or the file cannot be read.
        """
        names = tuple(fields)
        if isinstance(other, TrialResult):
            theirs = other.signals(names)
        else:
            from obk_testing.recording import read_signals

            width = None if self.states is None else self._qpos.shape[1]
            try:
                theirs = read_signals(Path(other), names, positions=width)
            except RecordingError as error:
                help = "run `obk test --keep-all` to keep recordings of passed tests"
                raise LookupError(f"{error.message}\n  help: {error.help or help}") from None
        for name, (t, mine) in self.signals(names).items():
            difference = _compare(name, t, mine, theirs[name][1], atol)
            if difference is not None:
                return Comparison(difference=difference)
        return Comparison(difference=None)

    def signals(self, fields: Iterable[str]) -> dict[str, tuple[Array, Array]]:
        """Return times and values of the positions, if any, and of some fields."""
        found: dict[str, tuple[Array, Array]] = {}
        if self.states is not None:
            found["qpos"] = (self.t, self._qpos)
        for name in fields:
            topic, _, path = name.partition(".")
            log = self[topic]
            found[name] = (log.t, np.asarray(log[path], float))
        if not found:
            self._require_states()
        return found

    def _note_look(self, key: tuple[str, ...]) -> None:
        self.facts.looked_at[key] = None

    def _require_states(self) -> StateLog:
        if self.states is None:
            raise LookupError("the stack has no MuJoCo simulator of Obelisk, so it has no states")
        return self.states

    def _state_differences(self, other: "TrialResult") -> Iterator[tuple[int, int, str]]:
        if self.states is None or other.states is None:
            return
        mine, others = self.states, other.states
        for place in range(min(self._count, other._count)):
            same = (
                mine.times_ns[place] == others.times_ns[place]
                and mine.positions[place].tobytes() == others.positions[place].tobytes()
                and mine.velocities[place].tobytes() == others.velocities[place].tobytes()
            )
            if not same:
                yield mine.times_ns[place], _FIRST, "the state of the simulator"
                return
        if self._count != other._count:
            longer = mine if self._count > other._count else others
            time_ns = longer.times_ns[min(self._count, other._count)]
            yield time_ns, _FIRST, f"the simulator took {self._count} and {other._count} steps"

    def _message_differences(self, other: "TrialResult") -> Iterator[tuple[int, int, str]]:
        for name in sorted({*self.topics, *other.topics}):
            mine = self.topics[name].entries if name in self.topics else ()
            others = other.topics[name].entries if name in other.topics else ()
            for number, (one, two) in enumerate(zip(mine, others, strict=False)):
                if (one[0], one[2]) != (two[0], two[2]):
                    fields = _differing_fields(self.topics[name], one[2], two[2])
                    yield *min(one[:2], two[:2]), f"message {number} of {name}: {fields}"
                    break
            else:
                if len(mine) != len(others):
                    longer = mine if len(mine) > len(others) else others
                    time_ns, place, _ = longer[min(len(mine), len(others))]
                    yield time_ns, place, f"{name} has {len(mine)} and {len(others)} messages"


def _compare(name: str, t: Array, mine: Array, theirs: Array, atol: float) -> str | None:
    count = min(len(mine), len(theirs))
    if abs(len(mine) - len(theirs)) > 1:
        return f"{name}: {len(mine)} and {len(theirs)} values"
    if mine.shape[1:] != theirs.shape[1:]:
        return f"{name}: shapes {mine.shape[1:]} and {theirs.shape[1:]}"
    mine, theirs = mine[:count], theirs[:count]
    differs = (mine != theirs) & ~(np.isnan(mine) & np.isnan(theirs))
    away = np.abs(np.subtract(mine, theirs, out=np.zeros_like(mine), where=differs))
    away[np.isnan(away)] = np.inf
    if not away.size:
        return f"{name} has no values to compare"
    if away.max() <= atol:
        return None
    row, *place = np.unravel_index(int(np.argmax(away)), away.shape)
    where = "".join(f"[{number}]" for number in place)
    return f"{name}{where} differs by {away.max():.3g} at {t[row]:.3f} s, more than {atol:g}"


def _differing_fields(messages: TopicLog, one: bytes, two: bytes) -> str:
    first, second = messages.unpack(one), messages.unpack(two)
    names = messages.message_class.get_fields_and_field_types()
    differing = [n for n in names if _bits(getattr(first, n)) != _bits(getattr(second, n))]
    return ", ".join(f"`{name}`" for name in differing) or "its time"


def _bits(value: Any) -> Any:
    """Return an object that is equal only for values with the same bits, also for NaN and -0.0."""
    if hasattr(value, "get_fields_and_field_types"):
        return [_bits(getattr(value, name)) for name in value.get_fields_and_field_types()]
    if isinstance(value, list):
        return [_bits(item) for item in value]
    if isinstance(value, np.ndarray | array):
        return value.tobytes()
    return struct.pack("d", value) if isinstance(value, float) else value


def joints_of(model: Any) -> dict[str, int]:
    """Return the joints of a MuJoCo model with one position: name -> index in qpos."""
    scalar = (2, 3)  # mjJNT_SLIDE, mjJNT_HINGE
    return {
        model.joint(number).name: int(model.jnt_qposadr[number])
        for number in range(model.njnt)
        if int(model.jnt_type[number]) in scalar
    }
