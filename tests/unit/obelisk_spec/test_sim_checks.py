import math
from dataclasses import replace
from typing import Any

import pytest

from obelisk_spec.model import ActuatorFact, ModelFacts, SensorFact
from obelisk_spec.scans import MOST_RAYS, grid_count, lidar_columns
from obelisk_spec.sensors import NOISY_FIELDS, SENSOR_GROUPS
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
            sensor("rate", "gyro"),
            sensor("pos", "framepos", "body", "tip"),
            sensor("tip_rot", "framequat", "body", "tip"),
        )
    },
    geoms={"box": "box"},
    sites=("imu",),
    cameras=("front",),
    keyframes=("home",),
    actuators=(ActuatorFact(name="motor", unit="N m"),),
    timestep=0.001,
)


def group(msg_type: str = "JointEncoders", **more: Any) -> dict[str, Any]:
    names = more.pop("names", {"q": "jointpos", "dq": "jointvel"})
    return {"topic": "/s", "dt": 0.01, "msg_type": msg_type, "sensor_names": names, **more}


def codes(block: dict[str, Any], parameters: dict[str, Any] | None = None) -> list[str]:
    block = {"model_xml_path": "m.xml", **block}
    return [fault.code for fault in check_sim(block, parameters or {}, FACTS)]


@pytest.mark.parametrize("step_s", [0.0, -1.0, math.nan, math.inf, 1e-300])
def test_a_model_without_a_valid_time_step_needs_one_in_the_config(step_s: float) -> None:
    facts = replace(FACTS, timestep=step_s)
    block = {"model_xml_path": "m.xml", "sensor_settings": [group()]}
    (fault,) = check_sim(block, {}, facts)
    assert (fault.code, fault.severity, fault.path) == ("OBK302", "error", ("model_xml_path",))
    assert "OBK302" not in [one.code for one in check_sim({**block, "time_step": 0.001}, {}, facts)]


def test_a_valid_block_has_no_findings() -> None:
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
        ({"sensor_settings": [group("ObkImage", names={"frnt": "camera"})]}, "OBK303"),
        ({"sensor_settings": [group("ObkImage", names={})]}, "OBK306"),
        ({"sensor_settings": [group("ObkImage", names={"front": "gyro"})]}, "OBK305"),
        ({"viz_geoms": {"dt": 1.0, "bx": "box"}}, "OBK311"),
        ({"viz_geoms": {"box": "sphere"}}, "OBK312"),
        ({"n_u": 2}, "OBK503"),
        ({"time_step": 0.002}, "OBK504"),
    ],
)
def test_a_fault_has_its_code(block: dict[str, Any], code: str) -> None:
    assert codes(block) == [code]


_SCAN = {"site_name": "imu", "pattern": {"type": "lidar_scan"}}


@pytest.mark.parametrize(
    ("block", "value"),
    [
        ({"viz_geoms": {1: "box"}}, "`viz_geoms` is {1: 'box'}, "),
        ({"viz_geoms": {"box": ["box"]}}, "`viz_geoms` is {'box': ['box']}, "),
        ({"sensor_settings": [group(names={"q": ["jointpos"]})]}, "`sensor_names` is {'q': ["),
        ({"sensor_settings": [group(names={None: "jointpos"})]}, "`sensor_names` is {None: "),
        ({"sensor_settings": [group(noise={3: {}})]}, "`noise` is {3: {}}, "),
        ({"sensor_settings": [group(noise={"y": {3: 1}})]}, "the noise of `y` is {3: 1}, "),
        ({"sensor_settings": [group(delay=False)]}, "`delay` is False, "),
        (
            {
                "sensor_settings": [
                    group("ObkScan", scan_config=_SCAN | {"pattern": {3: "lidar_scan"}})
                ]
            },
            "`pattern` is a mapping, ",
        ),
    ],
)
def test_values_that_only_yaml_has_are_findings_and_no_crash(
    block: dict[str, Any], value: str
) -> None:
    faults = check_sim({"model_xml_path": "m.xml", **block}, {}, FACTS)
    assert [fault.code for fault in faults] == ["OBK103"]
    assert faults[0].message.startswith(value)


def test_a_camera_of_the_model_is_accepted_and_a_typo_reported() -> None:
    assert codes({"sensor_settings": [group("ObkImage", names={"front": "camera"})]}) == []
    settings = [group("ObkImage", names={"frnt": "camera"})]
    (fault,) = check_sim({"model_xml_path": "m", "sensor_settings": settings}, {}, FACTS)
    assert fault.code == "OBK303"
    assert fault.help == "did you mean `front`?"


def test_a_missing_keyframe_is_a_fault_of_the_parameters() -> None:
    (fault,) = check_sim({"model_xml_path": "m"}, {"ic_keyframe": "hom"}, FACTS)
    assert fault.path == ("params", "ic_keyframe")
    assert fault.meant == "home"
    assert str(fault).startswith("error[OBK310]: params.ic_keyframe: ")


def test_near_names_are_sought_among_sensors_of_the_type_first() -> None:
    block = {"model_xml_path": "m", "sensor_settings": [group(names={"dqq": "jointvel"})]}
    (fault,) = check_sim(block, {}, FACTS)
    assert fault.help == "did you mean `dq`?"
    assert fault.path == ("sensor_settings", 0, "sensor_names", "dqq")


def test_of_a_great_many_missing_sensors_only_the_first_are_compared() -> None:
    names = {f"dq{number}": "jointvel" for number in range(5_000)}
    faults = check_sim({"model_xml_path": "m", "sensor_settings": [group(names=names)]}, {}, FACTS)
    assert {fault.code for fault in faults} == {"OBK303"}
    assert len(faults) == 5_000
    assert [fault.help for fault in faults[98:102]] == ["did you mean `dq`?"] * 2 + [None] * 2


def test_without_a_model_only_model_independent_settings_are_checked() -> None:
    block = {"model_xml_path": "m", "sensor_settings": [group(names={"x": "gyro"})]}
    assert [fault.code for fault in check_sim(block, {}, None)] == ["OBK305"]


@pytest.mark.parametrize(
    ("msg_type", "names", "help"),
    [
        ("JointEncoders", {"q": "jointposs"}, "write `q: jointpos`"),
        ("JointEncoders", {"q": "gyro"}, "write `q: jointpos`"),
        ("ObkImu", {"acc": "acelerometer", "rot": "framequat"}, "write `acc: accelerometer`"),
        ("ObkImage", {"front": "gyro"}, "write `front: camera`"),
        ("ObkImu", {"acc": "accelerometer", "q": "framequats"}, "did you mean `framequat`?"),
    ],
)
def test_an_invalid_sensor_type_is_reported_once_with_the_valid_one(
    msg_type: str, names: dict[str, str], help: str
) -> None:
    block = {"model_xml_path": "m", "sensor_settings": [group(msg_type, names=names)]}
    (fault,) = check_sim(block, {}, FACTS)
    assert fault.code == "OBK305"
    assert help in (fault.help or "")


def test_a_misspelled_sensor_name_is_reported_once() -> None:
    block = {"model_xml_path": "m", "sensor_settings": [group(names={"qq": "jointpos"})]}
    assert codes(block) == ["OBK303"]


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
def test_a_block_of_an_invalid_shape_has_no_other_findings(
    block: dict[str, Any], place: tuple[str | int, ...]
) -> None:
    faults = check_sim(block, {}, FACTS)
    assert {fault.code for fault in faults} <= {"OBK102", "OBK103"}
    assert [fault.path for fault in faults] == [place]


LIDAR: dict[str, Any] = {
    "type": "lidar_scan",
    "channels": 4,
    "vertical_fov_range": [-10, 10],
    "horizontal_fov_range": [0, 360],
    "horizontal_res": 1,
}
GRID: dict[str, Any] = {"type": "height_scan", "resolution": 0.1, "size": [1.6, 0.8]}
MATRIX = [20.0, 0, 8, 0, 20.0, 8, 0, 0, 1]
CAMERA: dict[str, Any] = {
    "type": "depth_camera",
    "width": 16,
    "height": 16,
    "intrinsic_matrix": MATRIX,
}


def scan_faults(pattern: dict[str, Any], kind: str = "ObkScan", **more: Any) -> list[str]:
    scan = {"site_name": "imu", "pattern": pattern, **more}
    settings = [{"topic": "/s", "dt": 0.01, "msg_type": kind, "scan_config": scan}]
    return [
        fault.message
        for fault in check_sim({"model_xml_path": "m", "sensor_settings": settings}, {}, FACTS)
    ]


@pytest.mark.parametrize("frame", ["world", "imu", "box", None])
def test_a_frame_is_the_world_or_a_thing_of_the_model(frame: str | None) -> None:
    assert scan_faults(GRID, "PointCloud2", frame=frame, points_in="frame") == []


def test_an_unknown_frame_is_reported_for_points() -> None:
    (message,) = scan_faults(GRID, "PointCloud2", frame="wold", points_in="frame")
    assert message.startswith("frame `wold` ")


@pytest.mark.parametrize("kind", ["ObkScan", "PointCloud2"])
def test_any_other_frame_is_a_label(kind: str) -> None:
    assert scan_faults(GRID, kind, frame="body") == []


def test_no_limit_may_be_written_as_0() -> None:
    assert scan_faults(GRID, max_distance=0.0) == []
    assert len(scan_faults(GRID, max_distance=-1.0)) == 1


@pytest.mark.parametrize(
    ("kind", "pattern", "more"),
    [
        ("ObkScan", {**GRID, "values": "distance"}, {}),
        ("ObkScan", {**GRID, "direction": [0.0, 0.0, -1.0]}, {}),
        ("ObkScan", {**LIDAR, "spacing": "exact"}, {}),
        ("DepthImage", {**CAMERA, "rays_through": "centres"}, {}),
        ("PointCloud2", GRID, {"points_in": "site", "keep_misses": True}),
    ],
)
def test_a_key_selects_a_behaviour(kind: str, pattern: dict[str, Any], more: Any) -> None:
    assert scan_faults(pattern, kind, **more) == []


@pytest.mark.parametrize(
    ("kind", "pattern", "more"),
    [
        ("ObkScan", GRID, {"points_in": "frame"}),
        ("DepthImage", CAMERA, {"keep_misses": True}),
        ("PointCloud2", {**GRID, "values": "height"}, {}),
        ("ObkScan", {**LIDAR, "direction": [1.0, 0.0, 0.0]}, {}),
        ("DepthImage", {**CAMERA, "direction": [1.0, 0.0, 0.0]}, {}),
    ],
)
def test_a_key_that_the_message_has_no_use_for_has_no_effect(
    kind: str, pattern: dict[str, Any], more: Any
) -> None:
    (message,) = scan_faults(pattern, kind, **more)
    assert "has no effect" in message


@pytest.mark.parametrize(
    ("kind", "pattern"),
    [
        ("ObkScan", {**GRID, "size": [1.6, -0.8]}),
        ("ObkScan", {**GRID, "offset": {"rot": [0, 0, 0, 0]}}),
        ("DepthImage", {**CAMERA, "intrinsic_matrix": [0.0, *MATRIX[1:]]}),
        ("DepthImage", {**CAMERA, "intrinsic_matrix": [*MATRIX[:8], 2.0]}),
        ("DepthImage", {**CAMERA, "rays_through": "middles"}),
        ("ObkScan", {**LIDAR, "spacing": 2}),
        ("ObkScan", {**GRID, "values": "z"}),
        ("ObkScan", {**GRID, "direction": [0, 0, 0]}),
    ],
)
def test_an_impossible_pattern_is_reported(kind: str, pattern: dict[str, Any]) -> None:
    (message,) = scan_faults(pattern, kind)
    assert ", expected " in message


@pytest.mark.parametrize(
    ("kind", "pattern", "count"),
    [
        ("ObkScan", {**GRID, "resolution": 1e-6}, "1.28e+12"),
        ("ObkScan", {**GRID, "resolution": 5e-324}, "inf"),
        ("ObkScan", {**LIDAR, "channels": 10_000}, "3.61e+06"),
        ("DepthImage", {**CAMERA, "width": 100_000}, "1.6e+06"),
    ],
)
def test_too_many_rays_are_rejected(kind: str, pattern: dict[str, Any], count: str) -> None:
    assert scan_faults(pattern, kind) == [
        f"`pattern` has {count} rays, expected at most {MOST_RAYS}"
    ]


@pytest.mark.parametrize(
    ("span", "step", "count"),
    [(360, 2, 180), (-360, 2, 180), (360, 7, 52), (180, 2, 91), (0, 1, 1), (90.5, 1, 91)],
)
def test_exactly_spaced_columns_leave_out_only_the_end_of_a_full_turn(
    span: float, step: float, count: int
) -> None:
    assert lidar_columns(span, step, is_exact=True) == (count, step)


@pytest.mark.parametrize(
    ("span", "step", "count", "spacing"),
    [
        (360, 2, 179, 360 / 179),
        (-360, 2, 179, 360 / 179),
        (360, 90, 3, 120),
        (360, 7, 51, 360 / 51),
        (360, 200, 1, 360),
        (360, 360, 1, 360),
        (100, 30, 4, 100 / 3),
        (180, 2, 90, 180 / 89),
        (1.8, 0.1, 18, 1.8 / 17),
        (1, 1, 1, 1),
        (0, 1, 1, 1),
    ],
)
def test_evenly_spread_columns_are_those_of_the_reference(
    span: float, step: float, count: int, spacing: float
) -> None:
    assert lidar_columns(span, step, is_exact=False) == (count, pytest.approx(spacing))


@pytest.mark.parametrize(
    ("length", "resolution", "count"),
    [(1.6, 0.1, 17), (0.0, 0.1, 1), (0.35, 0.1, 4), (0.3, 0.1, 4)],
)
def test_a_grid_has_a_ray_at_both_ends(length: float, resolution: float, count: int) -> None:
    assert grid_count(length, resolution) == count


IMU_SENSORS = {"acc": "accelerometer", "rate": "gyro", "rot": "framequat"}


def noise_faults(msg_type: str = "ObkImu", **given: Any) -> list[tuple[str, str]]:
    names = {"ObkImu": IMU_SENSORS, "ObkImage": {"front": "camera"}}
    settings = [group(msg_type, names=names.get(msg_type, {"q": "jointpos"}), **given)]
    return [
        (fault.code, ".".join(map(str, fault.path[2:])))
        for fault in check_sim({"model_xml_path": "m", "sensor_settings": settings}, {}, FACTS)
        if fault.severity == "error"
    ]


@pytest.mark.parametrize(
    "noise",
    [
        {},
        {"linear_acceleration": {"sigma": 1, "bias": -0.5}},
        {"orientation": {"sigma": [0.1, 0, 0.2], "bias": [-1, 0, 1]}},
        {"angular_velocity": {"sigma": None}},
    ],
)
def test_noise_is_a_number_or_one_for_each_axis(noise: dict[str, Any]) -> None:
    assert noise_faults(noise=noise, dropout=1, delay=0, seed=0) == []


@pytest.mark.parametrize(
    ("given", "code", "path"),
    [
        ({"noise": {"acceleration": {}}}, "OBK101", "noise.acceleration"),
        ({"noise": {"orientation": 0.1}}, "OBK103", "noise.orientation"),
        ({"noise": {"orientation": {"sgma": 0.1}}}, "OBK101", "noise.orientation.sgma"),
        ({"noise": {"orientation": {"sigma": -0.1}}}, "OBK103", "noise.orientation.sigma"),
        ({"noise": {"orientation": {"bias": [1, 2]}}}, "OBK103", "noise.orientation.bias"),
        (
            {"msg_type": "JointEncoders", "noise": {"y": {"bias": [1, 2, 3]}}},
            "OBK103",
            "noise.y.bias",
        ),
        ({"msg_type": "ObkImage", "delay": 0.1}, "OBK103", "delay"),
        (
            {"msg_type": "ObkJointEncoders", "noise": {"joint_vel": {"sigma": 1}}},
            "OBK306",
            "noise.joint_vel",
        ),
        ({"dropout": 1.5}, "OBK103", "dropout"),
        ({"delay": "1"}, "OBK103", "delay"),
        ({"seed": True}, "OBK103", "seed"),
    ],
)
def test_invalid_noise_is_reported_at_its_location(
    given: dict[str, Any], code: str, path: str
) -> None:
    assert noise_faults(**given) == [(code, path)]


@pytest.mark.parametrize("msg_type", NOISY_FIELDS)
def test_noise_of_a_field_is_for_sensors_that_the_message_takes(msg_type: str) -> None:
    takes = SENSOR_GROUPS[msg_type].takes
    for field in NOISY_FIELDS[msg_type]:
        names = {sensor_type: sensor_type for sensor_type in takes}
        settings = group(msg_type, names=names, noise={field: {"sigma": 1}})
        assert "OBK306" not in codes({"sensor_settings": [settings]})


def test_noise_is_not_reported_if_its_sensor_has_an_invalid_type() -> None:
    settings = group("ObkJointEncoders", names={"q": "jointpso"}, noise={"joint_pos": {}})
    assert codes({"sensor_settings": [settings]}) == ["OBK305"]
