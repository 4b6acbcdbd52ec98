"""What a run left: every message with its time, the state after every step, faults and logs."""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.lockstep.interception import LogEntry
from obelisk_py.core.lockstep.topics import Topic

__all__ = ["StateLog", "TopicLog", "TrialResult"]

Array = NDArray[Any]
_NS: Final = 1e-9


class TopicLog:
    """The messages of one topic; `messages.q_joints` is an array with a row for each."""

    def __init__(self, topic: Topic) -> None:
        """Take what a topic has logged."""
        self.name = topic.label
        self.message_class = topic.message_class
        self.log: Sequence[tuple[int, bytes]] = topic.log or ()
        """Time of publication [ns] and bytes."""
        self._unpack = topic.codec.unpack

    def __len__(self) -> int:
        return len(self.log)

    def __iter__(self) -> Iterator[Any]:
        return iter(self.messages)

    @cached_property
    def t(self) -> Array:
        """Times of publication [s], shape `(n,)`."""
        return np.array([sent_ns for sent_ns, _ in self.log]) * _NS

    @cached_property
    def messages(self) -> Sequence[Any]:
        """The messages."""
        return tuple(self._unpack(data) for _, data in self.log)

    def __getattr__(self, field: str) -> Array:
        if field.startswith("_") or field not in self.message_class.get_fields_and_field_types():
            fields = ", ".join(self.message_class.get_fields_and_field_types())
            raise AttributeError(f"{self.name} has no field `{field}`; it has {fields}")
        return np.array([getattr(message, field) for message in self.messages])

    def at(self, t: float) -> Any:
        """The newest message at a time [s].

        Raises:
            LookupError: none was published by then.
        """
        place = int(np.searchsorted(self.t, t + _NS / 2, side="right")) - 1
        if place < 0:
            raise LookupError(f"{self.name}: no message by {t:g} s")
        return self.messages[place]

    def joint(self, name: str, field: str) -> Array:
        """A field of one joint, by the `joint_names` of the messages, shape `(n,)`.

        Raises:
            LookupError: the messages name no such joint.
        """
        names = list(getattr(self.messages[0], "joint_names", ())) if len(self) else []
        if name not in names:
            raise LookupError(
                f"{self.name}: no joint `{name}`; it has {', '.join(names) or 'none'}"
            )
        column: Array = getattr(self, field)[:, names.index(name)]
        return column


class StateLog:
    """The states of one simulator, after every step."""

    def __init__(self, joints: Mapping[str, int]) -> None:
        """Begin without states; `joints` maps the name of a joint with one position to its qpos."""
        self.joints = joints
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
        seed: int,
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
            seed: of the trial.
            duration_s: simulated time [s].
            topics: by full name.
            states: of the simulator; None: there is none.
            faults: of nodes, as sentences.
            notes: of the engine.
            log: what the nodes logged.
            ways: why a topic of the config has no messages, by full name.
        """
        self.seed = seed
        self.duration_s = duration_s
        self.topics = {n: TopicLog(topic) for n, topic in topics.items() if topic.log is not None}
        self.faults = tuple(faults)
        """Faults of nodes, as in the log."""
        self.notes = tuple(notes)
        """What is not in lock-step, or takes time, by the engine."""
        self.log = tuple(log)
        self._states = states
        self._ways = ways
        self._count = len(states.times_ns) if states else 0

    def __getitem__(self, topic: str) -> TopicLog:
        if topic in self.topics:
            return self.topics[topic]
        if topic in self._ways:
            raise LookupError(self._ways[topic])
        raise LookupError(f"no topic `{topic}`; there are {', '.join(sorted(self.topics))}")

    @cached_property
    def t(self) -> Array:
        """Times of the states [s], shape `(n,)`."""
        return np.array(self._require_states().times_ns[: self._count]) * _NS

    @cached_property
    def qpos(self) -> Array:
        """Positions after each step, shape `(n, nq)`."""
        return np.array(self._require_states().positions[: self._count])

    @cached_property
    def qvel(self) -> Array:
        """Velocities after each step, shape `(n, nv)`."""
        return np.array(self._require_states().velocities[: self._count])

    def joint(self, name: str) -> Array:
        """Position of a hinge or slide joint after each step, shape `(n,)`.

        Raises:
            LookupError: the model has no such joint.
        """
        joints = self._require_states().joints
        if name not in joints:
            raise LookupError(f"the model has no joint `{name}`; it has {', '.join(joints)}")
        column: Array = self.qpos[:, joints[name]]
        return column

    def digest(self, topics: Iterable[str] | None = None) -> str:
        """SHA-256 of every state and of every message with its time.

        Args:
            topics: only these; None: all that are recorded.
        """
        digest = hashlib.sha256()
        if self._states is not None:
            for place in range(self._count):
                digest.update(self._states.times_ns[place].to_bytes(8, "little"))
                digest.update(self._states.positions[place].tobytes())
                digest.update(self._states.velocities[place].tobytes())
        for name in sorted(self.topics if topics is None else topics):
            digest.update(name.encode())
            for sent_ns, data in self[name].log:
                digest.update(sent_ns.to_bytes(8, "little"))
                digest.update(data)
        return digest.hexdigest()

    def first_difference(self, other: "TrialResult") -> str | None:
        """The place where two runs part, as a sentence; None: they are the same to the bit."""
        found = sorted([*self._state_differences(other), *self._message_differences(other)])
        return f"{found[0][0] * _NS:.6f} s: {found[0][1]}" if found else None

    def close_to(self, other: "TrialResult", *, atol: float) -> bool:
        """Whether all positions agree with those of another run within a tolerance."""
        count = min(len(self.qpos), len(other.qpos))
        same_length = abs(len(self.qpos) - len(other.qpos)) <= 1
        return same_length and bool(np.allclose(self.qpos[:count], other.qpos[:count], 0.0, atol))

    def _require_states(self) -> StateLog:
        if self._states is None:
            raise LookupError("the stack has no simulator of ours, so it has no state of one")
        return self._states

    def _state_differences(self, other: "TrialResult") -> Iterator[tuple[int, str]]:
        if self._states is None or other._states is None:
            return
        mine, others = self._states, other._states
        for place in range(min(self._count, other._count)):
            same = (
                mine.times_ns[place] == others.times_ns[place]
                and mine.positions[place].tobytes() == others.positions[place].tobytes()
                and mine.velocities[place].tobytes() == others.velocities[place].tobytes()
            )
            if not same:
                yield mine.times_ns[place], "the state of the simulator"
                return

    def _message_differences(self, other: "TrialResult") -> Iterator[tuple[int, str]]:
        for name in sorted({*self.topics, *other.topics}):
            mine = self.topics[name].log if name in self.topics else ()
            others = other.topics[name].log if name in other.topics else ()
            for number, (one, two) in enumerate(zip(mine, others, strict=False)):
                if one != two:
                    fields = _differing_fields(self.topics[name], one[1], two[1])
                    yield min(one[0], two[0]), f"message {number} of {name}: {fields}"
                    break
            else:
                if len(mine) != len(others):
                    shorter = min(len(mine), len(others))
                    at_ns = (mine if len(mine) > shorter else others)[shorter][0]
                    yield at_ns, f"{name} has {len(mine)} and {len(others)} messages"


def _differing_fields(messages: TopicLog, one: bytes, two: bytes) -> str:
    first, second = messages._unpack(one), messages._unpack(two)
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
