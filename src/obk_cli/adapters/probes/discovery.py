"""Two short-lived processes that call each other over ROS, in a domain that nobody else uses."""

import os
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Final

from obk_cli.adapters.probes.child import python_command, told_in_json, try_program
from obk_cli.adapters.probes.ros import find_rclpy
from obk_cli.doctor.network import DiscoveryFacts
from obk_cli.errors import CommandFailedError
from obk_cli.ros.environment import RosEnvironment, free_domain, ros_environment

__all__ = ["probe_discovery"]

PROGRAM: Final = "obk_cli.adapters.probes.discovery_program"
ANSWER_S: Final = 20.0
"""Of the one that calls, its start included: one second, unless the machine is busy [s]."""
KILL_S: Final = 2.0


def probe_discovery() -> DiscoveryFacts:
    """Start one that answers and one that calls, and measure.

    Raises:
        CommandFailedError: no domain is free, or ROS_DOMAIN_ID is none.
    """
    if find_rclpy() is None:
        return DiscoveryFacts(trial=None, domain=0)
    with free_domain() as domain:
        world = _stack_environment()
        variables = {**world.variables, "ROS_DOMAIN_ID": str(domain)}
        with _answering(variables):
            trial = try_program(
                python_command(PROGRAM, "call", str(os.getpid())),
                timeout_s=ANSWER_S,
                variables=variables,
            )
    return DiscoveryFacts(
        trial=trial,
        domain=domain,
        range=world.range,
        **told_in_json(trial),
    )


def _stack_environment() -> RosEnvironment:
    try:
        return ros_environment()
    except CommandFailedError as fault:
        raise CommandFailedError(fault.message, help="export ROS_DOMAIN_ID=0") from fault


@contextmanager
def _answering(variables: Mapping[str, str]) -> Iterator[None]:
    """While entered, there is a process that answers."""
    answering = subprocess.Popen(
        python_command(PROGRAM, "answer", str(os.getpid())),
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
