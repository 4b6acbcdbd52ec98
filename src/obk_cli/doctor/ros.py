"""Which ROS 2 is there, does it fit together, and what will its processes be told? Pure."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from obk_cli.doctor.finding import Finding, error, note, ok, warning

__all__ = ["RmwFacts", "RosFacts", "judge_rmw", "judge_ros"]

INSTALL_WHEELS: Final = "pip install 'obelisk-cli[ros]'"
SOURCE: Final = ". /opt/ros/jazzy/setup.sh"
OUR_DISTRIBUTION: Final = "jazzy"
NOTE_CURES: Final = {
    "RMW_IMPLEMENTATION": "unset RMW_IMPLEMENTATION",
    "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF": "unset ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS ": "export ROS_LOG_DIR=/tmp/ros-logs",
}
"""How a sentence of obk's own about the environment begins -> what mends it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RosFacts:
    """The ROS 2 that this Python would use."""

    rclpy_folder: str | None
    """Where `import rclpy` finds it; None: nowhere."""
    rclpy_version: str | None
    wheels_distribution: str | None
    """The ROS distribution that the wheels are of; None: no wheels are installed."""
    ros_distro: str | None
    """ROS_DISTRO as the shell has it."""
    machine: str
    """The processor's architecture, such as `x86_64`."""
    sourceable: tuple[str, ...]
    """`setup.sh` files of ROS 2 below /opt/ros."""
    unlike_pins: Mapping[str, tuple[str, str]]
    """Distribution -> (installed, pinned) version, of those of the ROS wheels that differ."""


def judge_ros(facts: RosFacts) -> Iterator[Finding]:
    """Whether there is a ROS 2, and only one."""
    if facts.rclpy_folder is None:
        yield _missing(facts)
        return
    distribution = facts.wheels_distribution or facts.ros_distro
    source = "wheels" if facts.wheels_distribution else "a sourced ROS 2"
    yield ok(
        f"ROS 2 {distribution or 'of unknown name'} from {source}: "
        f"rclpy {facts.rclpy_version or 'of unknown version'} in {facts.rclpy_folder}",
        distribution=distribution,
        rclpy=facts.rclpy_version,
        source=source,
    )
    if facts.wheels_distribution and facts.ros_distro not in (None, facts.wheels_distribution):
        yield warning(
            f"ROS_DISTRO={facts.ros_distro}, but the wheels are {facts.wheels_distribution}: the "
            f"sourced {facts.ros_distro} is not used here, and its tools may not understand this "
            "one's messages",
            "unset ROS_DISTRO    # or use a shell in which no other ROS 2 is sourced",
            ROS_DISTRO=facts.ros_distro,
        )
    elif distribution not in (None, OUR_DISTRIBUTION):
        yield warning(
            f"ROS 2 {distribution} is not the {OUR_DISTRIBUTION} that obk is tested with",
            SOURCE,
        )
    if facts.unlike_pins:
        pairs = facts.unlike_pins.items()
        listed = ", ".join(f"{name} {is_} instead of {pin}" for name, (is_, pin) in pairs)
        yield warning(
            f"ROS wheels of other versions than obk is made for: {listed}", INSTALL_WHEELS
        )


def _missing(facts: RosFacts) -> Finding:
    checking = "no ROS 2: this Python cannot import rclpy; configs can be checked, not launched"
    if facts.sourceable:
        return error(checking, f". {facts.sourceable[-1]}", found=facts.sourceable)
    if facts.machine == "x86_64":
        return error(checking, INSTALL_WHEELS)
    return error(
        f"{checking}; there are no ROS wheels for {facts.machine}",
        f"apt install ros-jazzy-ros-base && {SOURCE}",
        machine=facts.machine,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RmwFacts:
    """The middleware, and what obk tells ROS processes of the network."""

    installed: tuple[str, ...]
    asked_for: str | None
    """RMW_IMPLEMENTATION as the user has it."""
    used: str
    domain: int | None
    """None: ROS_DOMAIN_ID is none."""
    domain_fault: str
    range: str
    """ROS_AUTOMATIC_DISCOVERY_RANGE as stacks get it."""
    notes: tuple[str, ...]
    """What obk changes for its processes."""


def judge_rmw(facts: RmwFacts) -> Iterator[Finding]:
    """Which middleware is used, in which domain, seen by whom."""
    if facts.domain is None:
        yield error(facts.domain_fault, "export ROS_DOMAIN_ID=0")
        return
    if not facts.installed:
        yield error("no ROS middleware (librmw_*.so) is installed", INSTALL_WHEELS)
        return
    yield ok(
        f"middleware {facts.used}, ROS domain {facts.domain}, discovery {facts.range}",
        rmw=facts.used,
        installed=facts.installed,
        domain=facts.domain,
        range=facts.range,
    )
    for sentence in facts.notes:
        cures = (cure for begin, cure in NOTE_CURES.items() if sentence.startswith(begin))
        yield warning(sentence, next(cures, "unset ROS_LOCALHOST_ONLY ROS_STATIC_PEERS"))
    if facts.asked_for not in (None, "", "rmw_fastrtps_cpp") and facts.asked_for == facts.used:
        yield note(f"obk is tested with rmw_fastrtps_cpp, not with {facts.used}")
