"""The `multicast` and `discovery` checks: whether processes on this host reach each other.

Source: DDSI-RTPS 2.5, 9.6.1.4.2: participants are discovered at the group 239.255.0.1.
"""

import os
import socket
import struct
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from obk_cli.doctor.child import Trial, child_command, json_output, try_program
from obk_cli.doctor.finding import Fact, Finding, error, note, ok, warning
from obk_cli.doctor.ros import find_rclpy
from obk_cli.errors import CommandFailedError
from obk_cli.ros.domains import free_domain
from obk_cli.ros.environment import RosEnvironment, ros_environment

__all__ = [
    "DiscoveryFacts",
    "MulticastFacts",
    "judge_discovery",
    "judge_multicast",
    "probe_discovery",
    "probe_multicast",
]


LOOPBACK_FIX: Final = "sudo ip link set lo up multicast on && sudo ip route add 224.0.0.0/4 dev lo"
SLOW_S: Final = 3.0
"""If discovery takes longer, it missed the first announcements [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MulticastFacts:
    """Whether a datagram sent to a multicast group arrives, by interface."""

    group: str
    loopback_fault: str
    """Why it did not arrive over the loopback interface; empty if it did."""
    network_fault: str
    """The same for the interface that the system chooses."""
    unicast_fault: str
    """The same for 127.0.0.1, without a group."""


def judge_multicast(facts: MulticastFacts) -> Iterator[Finding]:
    """Report which kinds of UDP traffic work."""
    if facts.unicast_fault:
        yield error(
            f"UDP datagrams to 127.0.0.1 do not arrive: {facts.unicast_fault}",
            "sudo ip link set lo up",
        )
        return
    if facts.loopback_fault:
        yield warning(
            f"multicast to {facts.group} over loopback does not arrive: {facts.loopback_fault}",
            LOOPBACK_FIX,
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
    """Measurements of two ROS processes."""

    trial: Trial | None
    """How the calling process ended; None: rclpy is not installed."""
    domain: int
    """The free ROS domain that the test used."""
    range: str = ""
    """ROS_AUTOMATIC_DISCOVERY_RANGE as set for stacks."""
    rmw: str = ""
    first_answer_s: float | None = None
    """From the first call to the first answer, including the start of the other process [s]."""
    round_trip_ms: float | None = None
    """Median [ms]."""


def judge_discovery(facts: DiscoveryFacts) -> Iterator[Finding]:
    """Report whether the nodes of two processes discover each other."""
    if facts.trial is None:
        yield note("skipped: rclpy is not installed")
    elif facts.first_answer_s is None and facts.trial.end == "timed out":
        yield error(
            "two ROS processes on this host did not find each other within "
            f"{facts.trial.seconds:.0f} s",
            _fix_for_no_discovery(facts.range),
            domain=facts.domain,
            range=facts.range,
        )
    elif facts.first_answer_s is None or facts.round_trip_ms is None:
        yield error(
            f"a ROS process {facts.trial.outcome}",
            "obk doctor ros rmw interfaces",
            domain=facts.domain,
        )
    else:
        yield _judge_answer(facts, facts.first_answer_s, facts.round_trip_ms)


def _fix_for_no_discovery(range_: str) -> str:
    match range_:
        case "OFF":
            return "unset ROS_AUTOMATIC_DISCOVERY_RANGE    # OFF: nodes never discover each other"
        case "LOCALHOST":
            return "obk doctor multicast && sudo nft list ruleset    # does a firewall block UDP?"
        case _:
            return "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST obk doctor discovery"


def _judge_answer(facts: DiscoveryFacts, first_answer_s: float, round_trip_ms: float) -> Finding:
    sentence = (
        f"two ROS processes found each other after {first_answer_s:.1f} s, "
        f"round trip {round_trip_ms:.1f} ms"
    )
    measured: dict[str, Fact] = {
        "rmw": facts.rmw,
        "domain": facts.domain,
        "first_answer_s": first_answer_s,
        "round_trip_ms": round_trip_ms,
    }
    if first_answer_s > SLOW_S:
        return note(f"{sentence}; stacks will start slowly", "obk doctor cpu multicast", **measured)
    return ok(sentence, **measured)


GROUP: Final = "239.255.0.1"
LOOPBACK: Final = "127.0.0.1"
ANY: Final = "0.0.0.0"  # noqa: S104 - the kernel's choice; nothing is bound to it
DATAGRAM_S: Final = 1.0
PAYLOAD: Final = b"obk doctor"


def probe_multicast() -> MulticastFacts:
    """Send datagrams to an address, and to a group over each interface."""
    return MulticastFacts(
        group=GROUP,
        loopback_fault=_multicast_fault(LOOPBACK),
        network_fault=_multicast_fault(ANY),
        unicast_fault=_unicast_fault(),
    )


def _multicast_fault(interface: str) -> str:
    """Why a datagram to the group does not arrive over an interface; empty if it does."""
    address = socket.inet_aton(interface)
    try:
        with _udp() as receiver, _udp() as sender:
            receiver.bind((GROUP, 0))
            receiver.settimeout(DATAGRAM_S)
            membership = struct.pack("4s4s", socket.inet_aton(GROUP), address)
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            if interface != ANY:
                sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, address)
            # The test concerns this host only: keep the datagram off the network.
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
            return _send_and_receive(sender, receiver, GROUP)
    except OSError as fault:
        return _reason(fault)


def _unicast_fault() -> str:
    try:
        with _udp() as receiver, _udp() as sender:
            receiver.bind((LOOPBACK, 0))
            receiver.settimeout(DATAGRAM_S)
            return _send_and_receive(sender, receiver, LOOPBACK)
    except OSError as fault:
        return _reason(fault)


def _send_and_receive(sender: socket.socket, receiver: socket.socket, to: str) -> str:
    sender.sendto(PAYLOAD, (to, receiver.getsockname()[1]))
    return "" if receiver.recv(64) == PAYLOAD else "other bytes arrived"


def _udp() -> socket.socket:
    return socket.socket(socket.AF_INET, socket.SOCK_DGRAM)


def _reason(fault: OSError) -> str:
    if isinstance(fault, TimeoutError):
        return f"nothing arrived within {DATAGRAM_S:.0f} s"
    return fault.strerror or str(fault)


CALL_S: Final = 20.0
"""Limit for the calling process, including its start; about 1 s on an idle machine [s]."""
KILL_S: Final = 2.0


def probe_discovery() -> DiscoveryFacts:
    """Start an answering and a calling process in a free ROS domain, and measure.

    Raises:
        CommandFailedError: no domain is free, or ROS_DOMAIN_ID is not a domain.
    """
    if find_rclpy() is None:
        return DiscoveryFacts(trial=None, domain=0)
    with free_domain() as domain:
        world = _stack_environment()
        variables = {**world.variables, "ROS_DOMAIN_ID": str(domain)}
        with _answering(variables):
            trial = try_program(
                child_command("call", str(os.getpid())),
                timeout_s=CALL_S,
                variables=variables,
            )
    return DiscoveryFacts(
        trial=trial,
        domain=domain,
        range=world.range,
        **json_output(trial),
    )


def _stack_environment() -> RosEnvironment:
    try:
        return ros_environment()
    except CommandFailedError as fault:
        raise CommandFailedError(fault.message, help="export ROS_DOMAIN_ID=0") from fault


@contextmanager
def _answering(variables: Mapping[str, str]) -> Iterator[None]:
    """Keep an answering process running inside the `with` block."""
    answering = subprocess.Popen(
        child_command("answer", str(os.getpid())),
        env=variables,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        answering.terminate()
        try:
            answering.wait(KILL_S)
        except subprocess.TimeoutExpired:
            answering.kill()
            answering.wait()
