"""Can processes of this host reach each other, as DDS needs it? Facts in, findings out."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from obk_cli.doctor.finding import Fact, Finding, error, note, ok, warning
from obk_cli.doctor.trial import Trial

__all__ = ["DiscoveryFacts", "MulticastFacts", "judge_discovery", "judge_multicast"]

LOOPBACK_CURE: Final = "sudo ip link set lo up multicast on && sudo ip route add 224.0.0.0/4 dev lo"
SLOW_S: Final = 3.0
"""Two processes that take longer to hear each other miss their first announcements [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MulticastFacts:
    """A datagram sent to a group and awaited in the same process, each way."""

    group: str
    loopback_fault: str
    """Why it did not arrive over the loopback interface; empty: it did."""
    network_fault: str
    """The same over the interface that the system chooses."""
    unicast_fault: str
    """The same without a group, to 127.0.0.1."""


def judge_multicast(facts: MulticastFacts) -> Iterator[Finding]:
    """Whether datagrams arrive."""
    if facts.unicast_fault:
        yield error(
            f"UDP datagrams to 127.0.0.1 do not arrive: {facts.unicast_fault}",
            "sudo ip link set lo up",
        )
        return
    if facts.loopback_fault:
        yield warning(
            f"multicast to {facts.group} over loopback does not arrive: {facts.loopback_fault}",
            LOOPBACK_CURE,
        )
    if facts.network_fault:
        yield note(
            f"multicast to {facts.group} over the network does not arrive: {facts.network_fault}; "
            "a stack on two hosts needs it, or their addresses",
            "export ROS_STATIC_PEERS=other-host",
        )
    ways = ("loopback", facts.loopback_fault), ("the network", facts.network_fault)
    working = [way for way, fault in ways if not fault]
    if working:
        yield ok(f"UDP multicast to {facts.group} arrives over {' and '.join(working)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscoveryFacts:
    """Two processes that looked for each other over ROS."""

    trial: Trial | None
    """How the one that calls ended; None: there is no rclpy to try it with."""
    domain: int
    """The ROS domain that was free for it."""
    range: str = ""
    """ROS_AUTOMATIC_DISCOVERY_RANGE as stacks get it."""
    rmw: str = ""
    first_answer_s: float | None = None
    """From the first call to the first answer, the other process's start included [s]."""
    round_trip_ms: float | None = None
    """Median [ms]."""


def judge_discovery(facts: DiscoveryFacts) -> Iterator[Finding]:
    """Whether nodes of two processes hear each other."""
    if facts.trial is None:
        yield note("not tried: rclpy is not there")
    elif facts.first_answer_s is None and facts.trial.end == "timed out":
        yield error(
            "two ROS processes of this host did not hear each other within "
            f"{facts.trial.seconds:.0f} s",
            _cure_of_silence(facts.range),
            domain=facts.domain,
            range=facts.range,
        )
    elif facts.first_answer_s is None or facts.round_trip_ms is None:
        yield error(
            f"a ROS process {facts.trial.told}",
            "obk doctor ros rmw interfaces",
            domain=facts.domain,
        )
    else:
        yield _judge_answer(facts, facts.first_answer_s, facts.round_trip_ms)


def _cure_of_silence(range_: str) -> str:
    match range_:
        case "OFF":
            return "unset ROS_AUTOMATIC_DISCOVERY_RANGE    # OFF: nodes never look for each other"
        case "LOCALHOST":
            return "obk doctor multicast && sudo nft list ruleset    # does a firewall hold UDP up?"
        case _:
            return "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST obk doctor discovery"


def _judge_answer(facts: DiscoveryFacts, first_answer_s: float, round_trip_ms: float) -> Finding:
    sentence = (
        f"two ROS processes heard each other after {first_answer_s:.1f} s, "
        f"round trip {round_trip_ms:.1f} ms"
    )
    measured: dict[str, Fact] = {
        "rmw": facts.rmw,
        "domain": facts.domain,
        "first_answer_s": first_answer_s,
        "round_trip_ms": round_trip_ms,
    }
    if first_answer_s > SLOW_S:
        return note(
            f"{sentence}; stacks will be slow to come up", "obk doctor cpu multicast", **measured
        )
    return ok(sentence, **measured)
