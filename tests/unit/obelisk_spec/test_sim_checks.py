from typing import Any

import pytest

from obelisk_spec.model import ModelFacts, SensorFact
from obelisk_spec.sim_checks import check_sim


def sensor(name: str, kind: str, where: str = "site", at: str = "imu") -> SensorFact:
    return SensorFact(
        name=name,
        type=kind,
        object_type=where,
        object_name=at,
        joint_type="hinge" if where == "joint" else None,
    )


FACTS = ModelFacts(
    sensors={
        s.name: s
        for s in (
            sensor("q", "jointpos", "joint", "hinge"),
            sensor("dq", "jointvel", "joint", "hinge"),
            sensor("acc", "accelerometer"),
            sensor("rot", "framequat"),
            sensor("pos", "framepos", "body", "tip"),
            sensor("tip_rot", "framequat", "body", "tip"),
        )
    },
    geoms={"box": "box"},
    sites=("imu",),
    keyframes=("home",),
    actuators=1,
    timestep=0.001,
)


def group(msg_type: str = "JointEncoders", **more: Any) -> dict[str, Any]:
    names = more.pop("names", {"q": "jointpos", "dq": "jointvel"})
    return {"topic": "/s", "dt": 0.01, "msg_type": msg_type, "sensor_names": names, **more}


def codes(block: dict[str, Any], parameters: dict[str, Any] | None = None) -> list[str]:
    block = {"model_xml_path": "m.xml", **block}
    return [fault.code for fault in check_sim(block, parameters or {}, FACTS)]


def test_a_sound_block_has_no_findings() -> None:
    imu = group("ObkImu", names={"acc": "accelerometer", "rot": "framequat"})
    pose = group("sensor_msgs/Imu", names=imu["sensor_names"])
    block = {"sensor_settings": [group(), group("ObkJointEncoders")], "viz_geoms": {"box": "box"}}
    assert codes(block, {"ic_keyframe": "home"}) == []
    assert codes({"sensor_settings": [imu, pose]}) == ["OBK307", "OBK307"]


@pytest.mark.parametrize(
    ("block", "code"),
    [
        ({"sensor_settings": [group("Nothing")]}, "OBK319"),
        ({"sensor_settings": [group("obelisk_sensor_msgs/Imu")]}, "OBK319"),
        ({"sensor_settings": [group(names={"qq": "jointpos"})]}, "OBK303"),
        ({"sensor_settings": [group(names={"q": "jointvel"})]}, "OBK304"),
        ({"sensor_settings": [group(dt=0.0001)]}, "OBK215"),
        ({"sensor_settings": [group("ObkFramePose", names={"pos": "framepos"})]}, "OBK306"),
        (
            {
                "sensor_settings": [
                    group("ObkFramePose", names={"pos": "framepos", "rot": "framequat"})
                ]
            },
            "OBK308",
        ),
        ({"viz_geoms": {"dt": 1.0, "bx": "box"}}, "OBK311"),
        ({"viz_geoms": {"box": "sphere"}}, "OBK312"),
        ({"n_u": 2}, "OBK503"),
        ({"time_step": 0.002}, "OBK504"),
    ],
)
def test_a_fault_has_its_code(block: dict[str, Any], code: str) -> None:
    assert codes(block) == [code]


def test_a_keyframe_that_is_not_there_is_a_fault_of_the_parameters() -> None:
    (fault,) = check_sim({"model_xml_path": "m"}, {"ic_keyframe": "hom"}, FACTS)
    assert fault.path == ("params", "ic_keyframe")
    assert str(fault) == (
        "error[OBK310]: params.ic_keyframe: keyframe `hom` is not in the model "
        "(did you mean `home`?)"
    )


def test_near_names_are_sought_among_sensors_of_the_type_first() -> None:
    block = {"model_xml_path": "m", "sensor_settings": [group(names={"dqq": "jointvel"})]}
    (fault,) = check_sim(block, {}, FACTS)
    assert fault.help == "did you mean `dq`?"
    assert fault.path == ("sensor_settings", 0, "sensor_names", "dqq")


def test_without_a_model_only_what_needs_none_is_checked() -> None:
    block = {"model_xml_path": "m", "sensor_settings": [group(names={"x": "gyro"})]}
    assert [fault.code for fault in check_sim(block, {}, None)] == ["OBK305", "OBK306"]


@pytest.mark.parametrize(
    ("block", "place"),
    [
        ({}, ()),
        ({"model_xml_path": 3}, ("model_xml_path",)),
        ({"model_xml_path": "m", "sensor_settings": "x"}, ("sensor_settings",)),
        (
            {
                "model_xml_path": "m",
                "sensor_settings": [{"topic": "/s", "dt": 0, "msg_type": "Imu"}],
            },
            ("sensor_settings", 0, "dt"),
        ),
    ],
)
def test_a_block_of_the_wrong_shape_is_refused_before_anything_else(
    block: dict[str, Any], place: tuple[str | int, ...]
) -> None:
    faults = check_sim(block, {}, FACTS)
    assert {fault.code for fault in faults} <= {"OBK102", "OBK103"}
    assert [fault.path for fault in faults] == [place]
