"""Loading a model from a `sim` block: reports all errors, and selects the right settings."""

import pytest

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.loading import load_model
from obelisk_spec.components import format_setting

pytestmark = pytest.mark.mujoco


@pytest.fixture
def load(tmp_path, dummy_xml):
    """Load a block about the dummy model; keyword arguments change the block."""
    warnings = []

    def load(*, keyframe="", share_of=lambda _: None, **changes):
        block = {"model_xml_path": str(dummy_xml), **changes}
        return load_model(
            format_setting(block),
            keyframe=keyframe,
            folder=tmp_path,
            share_of=share_of,
            warn=warnings.append,
        )

    load.warnings = warnings
    return load


def _refusal(load, **changes):
    with pytest.raises(ObeliskConfigError) as caught:
        load(**changes)
    return str(caught.value)


def _group(**changes):
    return {"topic": "/x", "dt": 0.001, "msg_type": "ObkJointEncoders", **changes}


def test_the_block_of_the_example_is_loaded(load):
    loaded = load(
        sensor_settings=[_group(sensor_names={"joint_pos": "jointpos"}, history_depth=3)],
        viz_geoms={"dt": 0.5, "dummy_box": "box"},
    )
    assert loaded.keyframe == "ic"
    (group,) = loaded.config.groups
    assert (group.topic, group.period_s, group.history_depth) == ("/x", 0.001, 3)
    assert loaded.config.geoms == {"dummy_box": "box"}
    assert loaded.config.geoms_period_s == 0.5
    assert load.warnings == []


def test_all_findings_are_reported_together(load):
    rejection = _refusal(
        load,
        keyframe="stand",
        sensor_settings=[
            _group(sensor_names={"joint_pso": "jointpos", "joint_vel": "jointpos"}),
            _group(msg_type="ObkImu", sensor_names={"tip_acc_sensor": "acelerometer"}),
            _group(msg_type="ObkScan", scan_config={}),
            _group(msg_type="GridCells"),
            _group(msg_type="ObkScan", config_path="rays.yaml"),
        ],
        viz_geoms={"dt": 1.0, "dummy_sphere": "box"},
    )
    for part in (
        "sensor `joint_pso` is not in the model (did you mean `joint_pos`",
        "sensor `joint_vel` is declared as `jointpos`, but in the model it is a `jointvel`",
        "`ObkImu` cannot carry the `acelerometer` sensor",
        "a ray caster has no `site_name`",
        "this simulator does not publish `GridCells`; it publishes ObkJointEncoders, ",
        "sensor_settings[4].config_path: file not found: `rays.yaml`; tried ",
        "geom `dummy_sphere` is declared as `box`, but in the model it is a `sphere`",
        "keyframe `stand` is not in the model",
    ):
        assert part in rejection, rejection
    assert rejection.startswith("the sim block cannot be simulated:\n")


def test_a_ray_caster_is_read_from_its_file(load, tmp_path):
    scan = (
        "{site_name: tip, frame: world, pattern: {type: height_scan, resolution: 1, size: [2, 2]}}"
    )
    (tmp_path / "bare.yaml").write_text(scan)
    (tmp_path / "wrapped.yaml").write_text(f"scan_config: {scan}")
    loaded = load(
        sensor_settings=[
            _group(msg_type="ObkScan", config_path="bare.yaml"),
            _group(msg_type="ObkScan", config_path="wrapped.yaml"),
        ]
    )
    bare, wrapped = (group.rays for group in loaded.config.groups)
    assert bare == wrapped
    assert (bare.site, bare.frame) == ("tip", "world")


def test_variables_in_the_file_of_a_ray_caster_are_replaced(load, tmp_path, monkeypatch):
    monkeypatch.setenv("SITE_OF_CASE", "tip")
    (tmp_path / "rays.yaml").write_text(
        'site_name: "${SITE_OF_CASE}"\n'
        "max_distance: ${NOT_SET_IN_CASE:-2.5}\n"
        "pattern: {type: height_scan, resolution: 1, size: [2, 2]}\n"
    )
    group = _group(msg_type="ObkScan", config_path="rays.yaml")
    (loaded,) = load(sensor_settings=[group]).config.groups
    assert (loaded.rays.site, loaded.rays.max_distance_m) == ("tip", 2.5)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (
            "site_name: ${NOT_SET_IN_CASE}",
            "rays.yaml cannot be read: environment variable `NOT_SET_IN_CASE` is not set",
        ),
        (
            "[1, 2]",
            "rays.yaml is not a ray caster, expected a mapping with `site_name` and `pattern`",
        ),
        ("{a: {", "rays.yaml cannot be read: "),
        ("site_name: tpi", "site `tpi` is not in the model"),
    ],
)
def test_errors_in_the_file_of_a_ray_caster_are_reported(load, tmp_path, text, part):
    (tmp_path / "rays.yaml").write_text(text)
    group = _group(msg_type="ObkScan", config_path="rays.yaml")
    assert part in _refusal(load, sensor_settings=[group])


def test_a_missing_model_is_reported_with_the_other_findings(load, tmp_path):
    rejection = _refusal(
        load,
        model_xml_path="robot.xml",
        robot_pkg="my_robot",
        sensor_settings=[_group(sensor_names={"a": "gyro"})],
    )
    assert (
        f"model_xml_path: file not found: `robot.xml`; tried {tmp_path / 'robot.xml'}; "
        "the package `my_robot` was not found either" in rejection
    )
    assert "`ObkJointEncoders` cannot carry the `gyro` sensor `a`" in rejection


def test_a_relative_model_is_found_in_the_package(load, tmp_path, everything_xml):
    folder = tmp_path / "share" / "mujoco"
    folder.mkdir(parents=True)
    everything_xml.rename(folder / "robot.xml")
    loaded = load(
        model_xml_path="robot.xml", robot_pkg="my_robot", share_of=lambda _: tmp_path / "share"
    )
    assert loaded.model.nu == 2
    assert loaded.keyframe is None


def test_a_model_that_mujoco_rejects_is_reported_with_its_message(load, tmp_path):
    (tmp_path / "bad.xml").write_text("<mujoco><worldbdy/></mujoco>")
    rejection = _refusal(load, model_xml_path="bad.xml")
    assert f"MuJoCo rejects {tmp_path / 'bad.xml'}" in rejection
    assert "worldbdy" in rejection


def test_a_model_that_does_not_compile_is_reported_with_mujocos_message(load, tmp_path):
    (tmp_path / "bad.xml").write_text(
        "<mujoco><worldbody><body><joint/></body></worldbody></mujoco>"
    )
    rejection = _refusal(load, model_xml_path="bad.xml")
    assert rejection.startswith("model_xml_path: MuJoCo cannot compile it: ")


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "the parameter `mujoco_setting` is not set"),
        ("[1, 2]", "the parameter `mujoco_setting`: "),
        ("{a: {", "the parameter `mujoco_setting`: "),
        ("{num_steps_per_viz: 5}", "key `model_xml_path` is missing"),
    ],
)
def test_an_invalid_block_is_named(tmp_path, text, part):
    with pytest.raises(ObeliskConfigError) as caught:
        load_model(text, keyframe="", folder=tmp_path, share_of=lambda _: None, warn=print)
    assert part in str(caught.value)


@pytest.mark.parametrize("period", [0, -1.0, "often", True, float("inf")])
def test_an_invalid_period_of_the_geoms_is_named(load, period):
    rejection = _refusal(load, viz_geoms={"dt": period, "dummy_box": "box"})
    assert f"viz_geoms.dt: {period!r}, expected a number of seconds greater than 0" in rejection


def test_geoms_that_the_model_lacks_are_logged_once_and_left_out(load):
    loaded = load(viz_geoms={"dt": 1.0, "dummy_bx": "box", "dummy_box": "box", "rock": "sphere"})
    assert loaded.config.geoms == {"dummy_box": "box"}
    assert [warning.partition(" (")[0] for warning in load.warnings] == [
        f"warning[OBK311]: viz_geoms.{name}: geom `{name}` is not in the model, so it is not shown"
        for name in ("dummy_bx", "rock")
    ]


def test_a_time_step_that_is_not_the_models_is_used_and_logged(load):
    loaded = load(time_step=0.0005)
    assert loaded.model.opt.timestep == 0.0005
    (warning,) = load.warnings
    assert warning.startswith("warning[OBK504]: time_step: `time_step` is 0.0005 s, but the model ")


def test_a_geom_that_no_marker_can_show_is_named(load):
    rejection = _refusal(load, viz_geoms={"dt": 1.0, "floor": "plane"})
    assert (
        "viz_geoms.floor: a `plane` cannot be shown as a marker; expected one of: box, "
        in rejection
    )


def test_the_time_step_of_the_config_wins_with_a_warning(load):
    loaded = load(time_step=0.0005)
    assert loaded.model.opt.timestep == 0.0005
    assert len(load.warnings) == 1
    assert "`time_step` is 0.0005 s, but the model specifies 0.001 s" in load.warnings[0]


def test_the_requested_keyframe_is_used(load):
    assert load(keyframe="other").keyframe == "other"
