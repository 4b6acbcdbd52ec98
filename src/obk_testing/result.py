"""What a run left: every message with its time, the state after every step, faults and logs.

`run["/arm/est"].q_joints` is an array with a row for each message, `run.qpos` one with a row for
each step of the simulator.
"""

import functools
import hashlib
import importlib
import re
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.lockstep.interception import LogEntry
from obelisk_py.core.lockstep.scheduler import NS_PER_S
from obelisk_py.core.lockstep.topics import Topic
from obelisk_py.core.messages import message_name
from obelisk_spec.suggestions import did_you_mean
from obk_cli.plan.plan import Plan
from obk_cli.record.recorder import installed_definition
from obk_cli.ros.field_path import field_steps

__all__ = [
    "Comparison",
    "FieldLog",
    "Intervention",
    "StateLog",
    "TopicLog",
    "TrialFacts",
    "TrialResult",
]

__tracebackhide__ = True
"""Pytest shows the line of the test, not those in here."""

Array = NDArray[Any]
Steps = tuple[str | int, ...]
"""Names of fields and places in arrays, outermost first."""
LogKey = Literal["qpos", "qvel"]
_HALF_NS: Final = 0.5e-9
_FIRST: Final = -1
"""Place of a state: steps come before the messages of their time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Intervention:
    """Something that a test did to the stack."""

    t: float
    """When [s]."""
    duration: float
    """How long [s]; 0: at once, infinite: until the end."""
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialFacts:
    """What a trial was made from, and what the test did."""

    config: Path
    plan: Plan
    seed: int = 0
    schedule: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the schedule."""
    interventions: tuple[Intervention, ...] = ()
    looked_at: dict[tuple[str, ...], None] = field(default_factory=dict)
    """The arrays that the test read, in that order: (topic, field), (`qpos`,), (`joint`, name)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Whether two runs agree within a tolerance; true if they do."""

    difference: str | None
    """Where they differ most beyond it, as a sentence."""

    def __bool__(self) -> bool:
        return self.difference is None

    def __repr__(self) -> str:
        return self.difference or "the runs agree"


class FieldLog:
    """A field of messages that is itself a message; its fields are attributes.

    As an array, it has a row for each message and a column for each of its numbers.
    """

    def __init__(self, log: "TopicLog", steps: Steps, values: Sequence[Any]) -> None:
        """Take the values of the field, one for each message."""
        self._log = log
        self._steps = steps
        self._values = values

    def __repr__(self) -> str:
        return f"<{self._log.label}.{_path(self._steps)}: {len(self)} messages>"

    def __len__(self) -> int:
        return len(self._values)

    def __iter__(self) -> Iterator[Any]:
        return iter(self._values)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        del copy
        return np.array([list(_numbers(value)) for value in self._values], dtype or float)

    def __getitem__(self, place: Any) -> Any:
        return np.asarray(self)[place]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return self._log.field((*self._steps, name))


class TopicLog:
    """The messages of one topic; `messages.q_joints` is an array with a row for each.

    A field of a field is `messages.pose.position.x` or `messages["pose.position.x"]`. The second
    form also reads fields that are called as something here, such as `t` or `at`.
    """

    def __init__(
        self,
        label: str,
        message_class: type[Any],
        log: Sequence[tuple[int, int, bytes]],
        unpack: Callable[[bytes], Any],
        on_look: Callable[[tuple[str, ...]], None] = lambda _: None,
    ) -> None:
        """Take the messages of a topic.

        Args:
            label: name of the topic.
            message_class: of its messages.
            log: time of publication [ns], place among all messages, and bytes; what is added
                later is left out.
            unpack: bytes -> message.
            on_look: called with topic and field when a field is read.
        """
        self.label = label
        self.message_class = message_class
        self.unpack = unpack
        self._log = log
        self._count = len(log)
        self._on_look = on_look

    @classmethod
    def of(cls, topic: Topic, on_look: Callable[[tuple[str, ...]], None]) -> "TopicLog":
        """What a topic has logged so far."""
        return cls(topic.label, topic.message_class, topic.log or (), topic.codec.unpack, on_look)

    def __repr__(self) -> str:
        return f"<{self.label}: {self._count} messages>"

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Any]:
        return iter(self.messages)

    @cached_property
    def entries(self) -> Sequence[tuple[int, int, bytes]]:
        """Time of publication [ns], place among all messages of the run, bytes."""
        return tuple(islice(self._log, self._count))

    @cached_property
    def t(self) -> Array:
        """Times of publication [s], shape `(n,)`."""
        return np.array([sent_ns for sent_ns, _, _ in self.entries], dtype=np.int64) / NS_PER_S

    @cached_property
    def messages(self) -> Sequence[Any]:
        """The messages."""
        return tuple(self.unpack(data) for _, _, data in self.entries)

    @cached_property
    def stamps(self) -> Array:
        """Times in the headers of the messages [s], shape `(n,)`.

        Raises:
            LookupError: the messages have no header.
        """
        if "header" not in self.message_class.get_fields_and_field_types():
            raise LookupError(f"the messages of {self.label} have no header")
        stamps = [message.header.stamp for message in self.messages]
        return np.array([stamp.sec + stamp.nanosec / NS_PER_S for stamp in stamps])

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return self.field((name,))

    def __getitem__(self, path: str) -> Any:
        """A field by its path, such as `pose.position.x` or `ranges[0]`.

        Raises:
            LookupError: the messages have no such field.
        """
        steps = field_steps(f".{path}")
        if not steps:
            raise LookupError(f"`{path}` is no field: expected such as pose.position or ranges[0]")
        try:
            return self.field(steps)
        except AttributeError as error:
            raise LookupError(str(error)) from error

    def field(self, steps: Steps) -> Any:
        """The values of a field.

        Args:
            steps: names and places in arrays, outermost first.

        Returns:
            An array with a row for each message; for a field that is itself a message, a
            `FieldLog`.

        Raises:
            AttributeError: the messages have no such field.
            LookupError: an array of a message is shorter, or its length varies.
        """
        self._on_look((self.label, _path(steps)))
        values: list[Any] = list(self.messages)
        if not values:
            self._require(self.message_class, steps[0], ())
        for number, step in enumerate(steps):
            if isinstance(step, int):
                values = [self._item(value, step, steps[:number]) for value in values]
            elif values:
                self._require(type(values[0]), step, steps[:number])
                values = [getattr(value, step) for value in values]
        if values and hasattr(type(values[0]), "get_fields_and_field_types"):
            return FieldLog(self, steps, values)
        try:
            return np.array(values)
        except ValueError as error:
            raise LookupError(
                f"{self.label}: the length of `{_path(steps)}` varies, so it is no array; read it "
                "from `.messages`"
            ) from error

    def _item(self, value: Any, place: int, steps: Steps) -> Any:
        if isinstance(value, str) or not hasattr(value, "__getitem__"):
            raise AttributeError(f"{self.label}: `{_path(steps)}` is no array")
        if place >= len(value):
            raise LookupError(f"{self.label}: `{_path(steps)}` has only {len(value)} items")
        return value[place]

    def _require(self, kind: type[Any], name: str | int, before: Steps) -> None:
        find = getattr(kind, "get_fields_and_field_types", None)
        known = list(find()) if find is not None else []
        if name not in known:
            where = f"`{_path(before)}` of {self.label}" if before else self.label
            help = did_you_mean(str(name), known) or f"it has {', '.join(known) or 'none'}"
            raise AttributeError(f"{where} has no field `{name}`: {help}")

    def unit(self, field: str) -> str | None:
        """The unit of a field, such as `rad/s`; None if its definition names none.

        Args:
            field: its path, such as `q_joints` or `pose.position.x`.
        """
        message_class, unit = self.message_class, None
        for name in re.sub(r"\[\d+\]", "", field).split("."):
            kind = message_class.get_fields_and_field_types().get(name)
            if kind is None:
                return None
            # The vector of a message such as an Imu has the unit, its x has none of its own.
            unit = _unit_of(message_name(message_class), name) or unit
            inner = re.search(r"([a-z]\w*)/(\w+)", kind)
            if inner is not None:
                module = importlib.import_module(f"{inner[1]}.msg")
                message_class = getattr(module, inner[2])
        return unit

    def at(self, t: float) -> Any:
        """The newest message at a time [s].

        Raises:
            LookupError: none was published by then.
        """
        place = int(np.searchsorted(self.t, t + _HALF_NS, side="right")) - 1
        if place < 0:
            raise LookupError(f"{self.label}: no message by {t:g} s")
        return self.unpack(self._log[place][2])

    def joint(self, name: str, field: str) -> Array:
        """A field of one joint, by the names in the messages, shape `(n,)`.

        Args:
            name: of the joint.
            field: an array with an item for each joint, such as `q_joints`.

        Raises:
            LookupError: the messages name no such joint.
            AttributeError: they have no such field.
        """
        first = self.messages[0] if len(self) else None
        names = list(getattr(first, "joint_names", ()) or getattr(first, "name", ()))
        if name not in names:
            help = did_you_mean(name, names) or f"they name {', '.join(names) or 'none'}"
            raise LookupError(f"the messages of {self.label} name no joint `{name}`: {help}")
        column: Array = self[f"{field}[{names.index(name)}]"]
        return column


def _path(steps: Steps) -> str:
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps)
    return text.removeprefix(".")


def _numbers(value: Any) -> Iterator[float]:
    """The numbers in a message, those of arrays too, in its order."""
    if isinstance(value, bool | int | float | np.number):
        yield float(value)
    elif isinstance(value, np.ndarray | array | list | tuple):
        for item in value:
            yield from _numbers(item)
    elif hasattr(value, "get_fields_and_field_types"):
        for name in value.get_fields_and_field_types():
            yield from _numbers(getattr(value, name))


_UNIT: Final = re.compile(r"\[([^\[\]]+)\]")


@functools.cache
def _unit_of(msg_type: str, field: str) -> str | None:
    """The unit in the comment of a field, `[rad]`; None if it has several or none."""
    package, _, name = msg_type.split("/")
    comment: list[str] = []
    for line in (installed_definition(package, name) or "").splitlines():
        code, _, text = line.partition("#")
        if code.split()[1:2] == [field]:
            units = _UNIT.findall(" ".join([*comment, text]))
            return str(units[0]) if len(units) == 1 else None
        comment = [] if code.strip() or not line.strip() else [*comment, text]
    return None


class StateLog:
    """The states of one simulator, after every step."""

    def __init__(self, robot: str, model: Any) -> None:
        """Start without states.

        Args:
            robot: full name of its node.
            model: MuJoCo's.
        """
        self.robot = robot
        self.model = model
        self.joints = joints_of(model)
        """Joints with one position: name -> place in qpos."""
        self.times_ns: list[int] = []
        self.positions: list[Array] = []
        self.velocities: list[Array] = []

    def add(self, time_ns: int, data: Any) -> None:
        """Keep the state of MuJoCo's data at a time [ns]."""
        self.times_ns.append(time_ns)
        self.positions.append(data.qpos.copy())
        self.velocities.append(data.qvel.copy())


class TrialResult:
    """A trial up to a time."""

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
        """Take what a trial has collected.

        Args:
            facts: what it was made from.
            duration_s: simulated time [s].
            topics: by full name.
            states: of the simulator; None: there is none.
            faults: of nodes, as sentences.
            notes: of the engine.
            log: what the nodes logged.
            ways: why a topic of the config has no messages, by full name.
        """
        self.facts = facts
        self.duration_s = duration_s
        self.topics = {
            name: TopicLog.of(topic, self._note_look)
            for name, topic in topics.items()
            if topic.log is not None
        }
        """The recorded topics by full name."""
        self.faults = tuple(faults)
        """Faults of nodes, as in the log."""
        self.notes = tuple(notes)
        """What is not in lock-step, or takes time, by the engine."""
        self.log = tuple(log)
        """What the nodes logged."""
        self.states = states
        """Of the simulator; it may go on after this result."""
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
        help = did_you_mean(topic, self.topics) or f"there are {', '.join(sorted(self.topics))}"
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
        """SHA-256 of every state and of every message with its time.

        Args:
            topics: only these; None: all that are recorded.
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
        """The place where two runs part, as a sentence; None: they are the same to the bit."""
        found = sorted([*self._state_differences(other), *self._message_differences(other)])
        return f"{found[0][0] / NS_PER_S:.6f} s: {found[0][2]}" if found else None

    def close_to(
        self, other: "TrialResult | str | Path", *, atol: float, fields: Iterable[str] = ()
    ) -> Comparison:
        """Whether the positions of the simulator agree with those of another run.

        Args:
            other: the run, or the MCAP file that `obk test --keep-all` left of one.
            atol: greatest difference [unit of the positions and fields].
            fields: `TOPIC.FIELD` that have to agree too, message by message, such as
                `/arm/est.q_joints`.

        Returns:
            True in a condition if they agree; shown as the greatest difference otherwise.

        Raises:
            LookupError: a run lacks a field or the states.
            CommandFailedError: the file cannot be read.
        """
        names = tuple(fields)
        if isinstance(other, TrialResult):
            theirs = other.signals(names)
        else:
            from obk_testing.recording import read_signals

            width = None if self.states is None else self._qpos.shape[1]
            theirs = read_signals(Path(other), names, positions=width)
        for name, (t, mine) in self.signals(names).items():
            difference = _compare(name, t, mine, theirs[name][1], atol)
            if difference is not None:
                return Comparison(difference=difference)
        return Comparison(difference=None)

    def signals(self, fields: Iterable[str]) -> dict[str, tuple[Array, Array]]:
        """Times and values of the positions, if there are any, and of some fields."""
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
            raise LookupError("the stack has no simulator of ours, so it has no state of one")
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
    away = np.where(np.isnan(mine) & np.isnan(theirs), 0.0, np.abs(mine - theirs))
    away[np.isnan(away)] = np.inf
    if not away.size or away.max() <= atol:
        return None
    row, *place = np.unravel_index(int(np.argmax(away)), away.shape)
    where = "".join(f"[{number}]" for number in place)
    return f"{name}{where} differs by {away.max():.3g} at {t[row]:.3f} s, more than {atol:g}"


def _differing_fields(messages: TopicLog, one: bytes, two: bytes) -> str:
    first, second = messages.unpack(one), messages.unpack(two)
    names = messages.message_class.get_fields_and_field_types()
    differing = [n for n in names if repr(getattr(first, n)) != repr(getattr(second, n))]
    return ", ".join(f"`{name}`" for name in differing) or "its time"


def joints_of(model: Any) -> dict[str, int]:
    """The joints of a MuJoCo model with one position: name -> place in qpos."""
    scalar = (2, 3)  # mjJNT_SLIDE, mjJNT_HINGE
    return {
        model.joint(number).name: int(model.jnt_qposadr[number])
        for number in range(model.njnt)
        if int(model.jnt_type[number]) in scalar
    }
