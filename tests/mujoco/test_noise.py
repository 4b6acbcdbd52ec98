"""Noise, dropout and delay: magnitude, frequency, time, and reproducibility by seed."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message

from obelisk_py.core.sim.mujoco.control import ControlInbox
from obelisk_py.core.sim.mujoco.outputs import OutputContext, outputs_of
from obelisk_py.core.sim.mujoco.sim_config import typed_block
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.step_times import MonotonicClock
from obelisk_py.core.sim.mujoco.stepper import Stepper
from obelisk_spec.sensors import NOISY_FIELDS

pytestmark = pytest.mark.mujoco

ENCODERS = {
    "topic": "/q",
    "dt": 0.004,
    "msg_type": "ObkJointEncoders",
    "sensor_names": {"left_hip_pos": "jointpos", "left_hip_vel": "jointvel"},
}
IMU = {
    "topic": "/imu",
    "dt": 0.002,
    "msg_type": "ObkImu",
    "sensor_names": {"acc": "accelerometer", "gyro": "gyro", "imu_quat": "framequat"},
}
ODOMETRY = {
    "topic": "/odometry",
    "dt": 0.002,
    "msg_type": "Odometry",
    "sensor_names": {
        "centre_pos": "framepos",
        "centre_quat": "framequat",
        "centre_velocity": "velocimeter",
        "centre_gyro": "gyro",
    },
}
SCAN = {
    "topic": "/scan",
    "dt": 0.002,
    "msg_type": "ObkScan",
    "scan_config": {
        "site_name": "imu",
        "pattern": {
            "type": "lidar_scan",
            "channels": 4,
            "vertical_fov_range": [-80.0, 80.0],
            "horizontal_fov_range": [0.0, 360.0],
            "horizontal_res": 90.0,
        },
    },
}


@pytest.fixture
def run(everything):
    """Run a model that rests in the air; return each group's messages and their steps."""
    everything.opt.gravity[:] = 0

    def run(groups, steps=400, *, runs=1, paused_at=None, listeners=1):
        block = typed_block({"model_xml_path": "m", "sensor_settings": groups})
        simulation = Simulation(
            everything, ControlInbox(field="u", size=everything.nu, monotonic_s=lambda: 0.0)
        )
        received = {}

        def make_publisher(message_type, topic, _depth):
            sent = received.setdefault(topic, SimpleNamespace(messages=[], steps=[], counted=[]))

            def publish(message):
                sent.messages.append(deserialize_message(message, message_type))
                sent.steps.append(simulation.steps)

            return SimpleNamespace(publish=publish, get_subscription_count=lambda: listeners)

        def promise(topic, period_s):
            return lambda: received[topic].counted.append(period_s)

        surroundings = OutputContext(
            make_publisher=make_publisher,
            warn=pytest.fail,
            on_close=pytest.fail,
            is_paced=False,
            monitor_rate=promise,
        )
        stepper = Stepper(
            simulation,
            pace=None,
            clock=MonotonicClock(),
            outputs=outputs_of(simulation, block, surroundings),
            stamp=lambda: simulation.time_ns,
            warn=pytest.fail,
            report=lambda _: None,
        )
        for _ in range(runs):
            simulation.reset(None)
            if paused_at is not None:
                stepper.run(lambda: simulation.steps >= paused_at)
                for _ in range(3):
                    stepper.step()
            stepper.run(lambda: simulation.steps >= steps)
        return received

    return run


def _xyz(messages, get):
    return np.array([[get(m).x, get(m).y, get(m).z] for m in messages])


def test_a_message_dropped_or_delayed_on_purpose_breaks_no_rate(run):
    for more in ({}, {"dropout": 0.3}, {"delay": 0.01}, {"dropout": 1.0}):
        assert run([{**IMU, "dt": 0.004, **more}])["/imu"].counted == [0.004] * 200, more


def test_a_group_expects_at_most_one_sample_per_step(run):
    assert run([{**IMU, "dt": 0.0005}], 10)["/imu"].counted == [0.002] * 10


def test_noise_has_the_spread_and_the_bias_that_were_written(run):
    noise = {
        "linear_acceleration": {"sigma": 0.5, "bias": 0.25},
        "angular_velocity": {"sigma": [0.1, 0.2, 0.0], "bias": [1.0, 0.0, -1.0]},
    }
    clean, noisy = (run([group], 4000)["/imu"].messages for group in (IMU, {**IMU, "noise": noise}))
    acceleration, rate = (
        _xyz(noisy, get) - _xyz(clean, get)
        for get in (lambda m: m.linear_acceleration, lambda m: m.angular_velocity)
    )
    # Five standard errors of the mean and of the spread; the seed is fixed.
    assert acceleration.mean(axis=0) == pytest.approx([0.25] * 3, abs=0.04)
    assert acceleration.std(axis=0) == pytest.approx([0.5] * 3, abs=0.03)
    assert abs(np.corrcoef(acceleration.T) - np.eye(3)).max() < 0.08
    assert rate.mean(axis=0) == pytest.approx([1.0, 0.0, -1.0], abs=0.016)
    assert rate.std(axis=0) == pytest.approx([0.1, 0.2, 0.0], abs=0.012)
    assert noisy[0].orientation == clean[0].orientation


def test_a_noisy_orientation_is_rotated_about_its_own_axes_and_normalized(run):
    turned = {**IMU, "noise": {"orientation": {"bias": [0.0, 0.0, 0.3]}}}
    clean, noisy = (run([group], 1)["/imu"].messages[0].orientation for group in (IMU, turned))
    c, s = math.cos(0.15), math.sin(0.15)
    wanted = [
        clean.w * c - clean.z * s,
        clean.x * c + clean.y * s,
        clean.y * c - clean.x * s,
        clean.z * c + clean.w * s,
    ]
    assert [noisy.w, noisy.x, noisy.y, noisy.z] == pytest.approx(wanted)
    spread = {**IMU, "noise": {"orientation": {"sigma": 0.2}}}
    for message in run([spread], 50)["/imu"].messages:
        q = message.orientation
        assert q.w**2 + q.x**2 + q.y**2 + q.z**2 == pytest.approx(1.0)


def test_every_field_that_may_be_noisy_is_changed_and_no_other(run):
    clean = run([ODOMETRY], 1)["/odometry"].messages[0]
    places = {
        "position": lambda m: m.pose.pose.position,
        "orientation": lambda m: m.pose.pose.orientation,
        "linear": lambda m: m.twist.twist.linear,
        "angular": lambda m: m.twist.twist.angular,
    }
    assert set(places) == set(NOISY_FIELDS["Odometry"])
    for field in places:
        noisy = run([{**ODOMETRY, "noise": {field: {"sigma": 1.0}}}], 1)["/odometry"].messages[0]
        changed = {name for name, get in places.items() if get(noisy) != get(clean)}
        assert changed == {field}
        assert noisy.header == clean.header


def test_noise_in_arrays_has_their_precision(run):
    noise = {"joint_pos": {"sigma": 0.1}, "joint_vel": {"bias": 2.0}}
    clean, noisy = (
        run([group], 8)["/q"].messages[-1] for group in (ENCODERS, {**ENCODERS, "noise": noise})
    )
    assert noisy.joint_pos[0] != clean.joint_pos[0]
    assert noisy.joint_vel[0] == pytest.approx(clean.joint_vel[0] + 2.0, abs=1e-15)
    assert noisy.joint_names == ["left_hip"]


def test_a_ray_without_a_hit_stays_a_miss_with_noise(run):
    clean, noisy = (
        np.array(run([group], 1)["/scan"].messages[0].data)
        for group in (SCAN, {**SCAN, "noise": {"data": {"bias": 0.5}}})
    )
    assert np.isnan(clean).any()
    assert not np.isnan(clean).all()
    assert np.allclose(noisy, clean + 0.5, equal_nan=True)


@pytest.mark.parametrize("keep_misses", [False, True])
def test_the_points_of_a_cloud_are_disturbed_as_numbers(run, keep_misses):
    scan = {**SCAN["scan_config"], "keep_misses": keep_misses}
    cloud = {**SCAN, "msg_type": "PointCloud2", "scan_config": scan}
    clean, noisy = (
        np.frombuffer(run([group], 2)["/scan"].messages[1].data, np.float32).reshape(-1, 4)
        for group in (cloud, {**cloud, "noise": {"data": {"bias": 0.5}}})
    )
    assert np.allclose(noisy[:, :3], clean[:, :3] + np.float32(0.5), equal_nan=True)
    assert np.array_equal(noisy[:, 3], clean[:, 3]), "the intensity stays"


def test_dropout_leaves_out_its_share(run):
    steps = run([{**IMU, "dropout": 0.3}], 4000)["/imu"].steps
    assert len(steps) / 4000 == pytest.approx(0.7, abs=0.04)
    assert run([{**IMU, "dropout": 1.0}])["/imu"].steps == []
    assert len(run([{**IMU, "dropout": 0}])["/imu"].steps) == 400


@pytest.mark.parametrize(("delay", "late"), [(0.002, 1), (0.0025, 2), (0.01, 5), (1e-5, 1)])
def test_a_delayed_message_follows_the_step_that_reaches_its_time(run, delay, late):
    sent = run([{**ENCODERS, "delay": delay}], 100)["/q"]
    sampled = [round(message.header.stamp.nanosec / 2e6) for message in sent.messages]
    assert sampled[:3] == [2, 4, 6]
    assert sent.steps == [step + late for step in sampled]
    assert len(sent.steps) == (100 - late) // 2


def test_noise_and_dropout_are_the_same_in_every_run_of_a_seed(run):
    group = {**IMU, "noise": {"angular_velocity": {"sigma": 1.0}}, "dropout": 0.5, "delay": 0.01}

    def rates(seed=0, topic="/imu", **run_options):
        sent = run([{**group, "seed": seed, "topic": topic}], 100, **run_options)[topic]
        numbers = _xyz(sent.messages, lambda m: m.angular_velocity).tolist()
        return list(zip(sent.steps, numbers, strict=True))

    assert rates() == rates()
    assert rates(paused_at=40) == rates(), "a pause and single steps change nothing"
    assert rates(runs=2) == rates() + rates(), "a run after a reset is the same again"
    assert rates(seed=1) != rates(seed=2)
    assert rates(topic="/other_imu") != rates()


def test_random_numbers_do_not_depend_on_subscribers(run):
    group = {**IMU, "noise": {"angular_velocity": {"sigma": 1.0}}, "dropout": 0.5}
    received, unheard = (run([group], 50, listeners=count)["/imu"].steps for count in (1, 0))
    assert received == unheard


def test_samples_without_a_subscriber_count_towards_the_rate(run):
    sent = run([IMU], 50, listeners=0)["/imu"]
    assert sent.messages == []
    assert len(sent.counted) == 50


def test_noise_of_one_field_does_not_depend_on_that_of_another(run):
    one = {"angular_velocity": {"sigma": 1.0}}
    both = {"linear_acceleration": {"sigma": 1.0}, **one}
    alone, together = (run([{**IMU, "noise": n}], 20)["/imu"].messages for n in (one, both))
    assert [m.angular_velocity for m in alone] == [m.angular_velocity for m in together]
    clean = run([IMU], 20)["/imu"].messages
    added = [
        _xyz(together, get) - _xyz(clean, get)
        for get in (lambda m: m.angular_velocity, lambda m: m.linear_acceleration)
    ]
    assert not np.allclose(*added), "each has random numbers of its own"


@pytest.mark.parametrize("msg_type", NOISY_FIELDS)
def test_every_noisy_field_is_one_that_the_message_has(msg_type):
    from obelisk_py.core.sim.mujoco.noise import field_place
    from obelisk_py.core.sim.mujoco.sensors import SENSOR_KINDS

    for field in NOISY_FIELDS[msg_type]:
        value = SENSOR_KINDS[msg_type].message_type()
        for part in field_place(msg_type, field).split("."):
            value = getattr(value, part)
