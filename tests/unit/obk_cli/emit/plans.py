"""Fake plans to emit."""

from obk_cli.plan.plan import Endpoint, Plan, PlannedNode, PlannedSensorGroup

from .. import plans  # noqa: TID252 - shared by folders of tests

__all__ = ["loop", "node"]


def node(
    section: str,
    name: str = "0",
    *,
    publishes_to: tuple[str, ...] = (),
    subscribes_to: tuple[str, ...] = (),
    **others: object,
) -> PlannedNode:
    """A process of a section that publishes and subscribes to topics."""
    settings: dict[str, object] = {
        "package": "demo",
        "executable": "run",
        "publishes": tuple(
            Endpoint(topic=t, msg_type="a_msgs/msg/T", rate_hz=10.0) for t in publishes_to
        ),
        "subscribes": tuple(Endpoint(topic=t, msg_type="a_msgs/msg/T") for t in subscribes_to),
        "has_lifecycle": section != "joystick",
    }
    return plans.node(f"obelisk_{section}_{name}", section, **{**settings, **others})


def loop() -> Plan:
    """A control loop of four nodes on two devices, in an arbitrary order, and a joystick."""
    return Plan(
        name='arm <"&">',
        nodes=(
            node(
                "control",
                publishes_to=("/ctrl",),
                subscribes_to=("/est", "/joy"),
                device="offboard",
            ),
            node(
                "robot",
                "a",
                publishes_to=("/q",),
                subscribes_to=("/ctrl",),
                parameters={"text": "it's '''"},
            ),
            node("estimation", publishes_to=("/est",), subscribes_to=("/q", "/imu")),
            node(
                "robot",
                "b",
                publishes_to=("/imu",),
                model="/models/arm.xml",
                namespace="/left",
                remappings=(("/a", "/b"),),
                env={"A": "1"},
                log_level="debug",
                sensor_groups=(
                    PlannedSensorGroup(
                        topic="/imu",
                        kind="ObkImu",
                        sensors={'g"1': "gyro", "g2": "gyro", "<a>": "accelerometer"},
                    ),
                ),
            ),
            node("joystick", publishes_to=("/joy",), device="offboard", node="obelisk_joystick"),
        ),
    )
