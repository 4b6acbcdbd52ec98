"""The datagrams between a computer and the drive: commands and states.

Little endian, without padding:

| command | bytes | state | bytes |
|---|---|---|---|
| magic `OBMC` | 4 | magic `OBMS` | 4 |
| sequence, uint32 | 4 | sequence, uint32 | 4 |
| mode, uint32 | 4 | time since the drive was switched on [s], float64 | 8 |
| value, float64 | 8 | position [rad], float64 | 8 |
| | | velocity [rad/s], float64 | 8 |
| | | faults, uint32 | 4 |

Each side numbers its datagrams; the sequence continues at 0 after 4294967295. This module uses
neither ROS nor a socket.
"""

import math
import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag

__all__ = ["PORT", "Command", "Fault", "Mode", "State", "steps_ahead"]

PORT = 47001
"""The default UDP port of the drive."""
SEQUENCES = 1 << 32
COMMAND = struct.Struct("<4sIId")
COMMAND_MAGIC = b"OBMC"
STATE = struct.Struct("<4sIdddI")
STATE_MAGIC = b"OBMS"


class Mode(IntEnum):
    """The kind of a command."""

    LISTEN = 0
    """Only request states; changes neither the motor nor the watchdog."""
    TORQUE = 1
    """The value is a torque [N m]; zero also clears faults."""
    POSITION = 2
    """The value is a desired position [rad]."""


class Fault(IntFlag):
    """The reason why the motor is off."""

    NONE = 0
    WATCHDOG = 1
    """The drive received no command for too long; it executes the next one."""
    OVERSPEED = 2
    """The motor was too fast; it stays off until a command of zero torque."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """A datagram to the drive."""

    sequence: int
    mode: Mode
    value: float = 0.0
    """Torque [N m] or position [rad], depending on the mode; finite."""

    def pack(self) -> bytes:
        """Encode the command as a datagram."""
        return COMMAND.pack(COMMAND_MAGIC, self.sequence, self.mode, self.value)

    @classmethod
    def unpack(cls, data: bytes) -> "Command | None":
        """Decode a datagram; None if it is not a command."""
        if len(data) != COMMAND.size:
            return None
        magic, sequence, mode, value = COMMAND.unpack(data)
        if magic != COMMAND_MAGIC or mode not in list(Mode) or not math.isfinite(value):
            return None
        return cls(sequence=sequence, mode=Mode(mode), value=value)


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """A datagram from the drive."""

    sequence: int
    time_s: float
    """Time since the drive was switched on [s]."""
    position: float
    """[rad]."""
    velocity: float
    """[rad/s]."""
    faults: Fault

    def pack(self) -> bytes:
        """Encode the state as a datagram."""
        numbers = (self.time_s, self.position, self.velocity)
        return STATE.pack(STATE_MAGIC, self.sequence, *numbers, self.faults)

    @classmethod
    def unpack(cls, data: bytes) -> "State | None":
        """Decode a datagram; None if it is not a state."""
        if len(data) != STATE.size:
            return None
        magic, sequence, time_s, position, velocity, faults = STATE.unpack(data)
        if magic != STATE_MAGIC or not all(map(math.isfinite, (time_s, position, velocity))):
            return None
        return cls(
            sequence=sequence,
            time_s=time_s,
            position=position,
            velocity=velocity,
            faults=Fault(faults),
        )


def steps_ahead(sequence: int, last: int) -> int:
    """How far a sequence number is ahead of another: 1 for the next one, below 1 if not newer."""
    ahead = (sequence - last) % SEQUENCES
    return ahead if ahead < SEQUENCES // 2 else ahead - SEQUENCES
