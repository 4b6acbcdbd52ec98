"""Topics to record, as given on the command line."""

import pytest

from obk_cli.cli.launch_plan import recording_of
from obk_cli.cli.record import request_of
from obk_cli.errors import MisuseError
from obk_cli.plan.plan import Endpoint, Origin, Plan, PlannedNode

EST, IMU, OTHER = "/arm/est", "/arm/imu", "/leg/imu"
KNOWN = {EST: "pkg/msg/State", IMU: None, OTHER: None}


def test_a_suffix_names_the_stacks_topic_and_other_names_are_waited_for() -> None:
    request = request_of(["est", "/joy", "cmd", "*imu"], KNOWN)
    assert request.topics == {EST: "pkg/msg/State", "/joy": None, "/cmd": None}
    assert request.patterns == ("*imu",)
    assert request_of([], KNOWN).topics == KNOWN
    assert request_of([], KNOWN, every=True).patterns == ("*",)


def test_a_suffix_of_several_topics_is_misuse() -> None:
    with pytest.raises(MisuseError, match="`imu` is ambiguous"):
        request_of(["imu"], KNOWN)


def test_a_launch_records_no_short_name_that_is_missing_in_the_config() -> None:
    origin = Origin(path="c.yaml", line=1, column=1)
    node = PlannedNode(
        node="est",
        namespace="/",
        section="estimation",
        device="onboard",
        package="p",
        executable="e",
        origin=origin,
        publishes=(Endpoint(topic=EST, msg_type="pkg/msg/State"),),
    )
    plan = Plan(name="arm", nodes=(node,))
    assert recording_of(["est"], plan).topics == {EST: "pkg/msg/State"}
    assert recording_of(["/joy"], plan).topics == {"/joy": None}
    assert recording_of([], plan).topics == {}
    with pytest.raises(MisuseError, match="the config has no such topic"):
        recording_of(["state"], plan)
