"""`obk topic pub` on the commands of a robot while its stack is starting."""

import pytest

from .stack import DEADLINE_S, DUMMY, launched, obk

pytestmark = pytest.mark.ros


def test_a_publisher_that_the_user_allows_does_not_end_a_launch_in_its_first_seconds() -> None:
    with launched(DUMMY, "--quiet") as stack:
        words = ("topic", "pub", "ctrl", "{u_mujoco: [0.0]}", "-n", "30", "--rate", "10")
        done = obk(*words, "--allow-foreign", "--timeout", str(DEADLINE_S))
        assert done.stdout == "published 30 messages on /obelisk/dummy/ctrl\n", done.stderr
        assert stack.process.poll() is None, stack.text
        assert obk("lifecycle", "get", "control_0").stdout.split()[1:] == ["active"]
