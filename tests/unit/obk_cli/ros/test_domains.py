"""ROS domains in use on this host."""

import socket

import pytest

from obk_cli.launch.conflicts import may_have_others
from obk_cli.ros import domains
from obk_cli.ros.domains import free_domain, is_used
from obk_cli.ros.environment import ros_environment


def test_a_domain_is_used_while_a_participant_has_a_port(monkeypatch: pytest.MonkeyPatch) -> None:
    with free_domain() as domain, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        assert not is_used(domain)
        assert not may_have_others(ros_environment())
        assert may_have_others(ros_environment("lan"))
        participant.bind(("127.0.0.1", 7400 + 250 * domain + 10))
        assert is_used(domain)
        assert may_have_others(ros_environment())


def test_a_port_of_ipv6_counts() -> None:
    with free_domain() as domain, socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as participant:
        participant.bind(("::1", 7400 + 250 * domain + 10))
        assert is_used(domain)


def test_if_the_ports_are_unknown_a_domain_may_be_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(domains, "TABLE", domains.TABLE.with_name("missing"))
    assert is_used(42)
