"""The messages of a `sim` block: topics, rates in simulation time, and values."""

import pytest
from rclpy.serialization import deserialize_message

from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.control import ControlInbox
from obelisk_py.core.sim.mujoco.loading import load_model
from obelisk_py.core.sim.mujoco.outputs import OutputContext, outputs_of
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.step_times import MonotonicClock
from obelisk_py.core.sim.mujoco.stepper import Stepper
from obelisk_spec.components import format_setting
from obelisk_spec.yaml_core import load_yaml_core

pytestmark = pytest.mark.mujoco


class _Publisher:
    def __init__(self, message_type, topic, depth, listeners):
        self.message_type, self.topic, self.depth = message_type, topic, depth
        self.messages = []
        self.listeners = listeners

    def get_subscription_count(self):
        return self.listeners

    def publish(self, message):
        self.messages.append(deserialize_message(message, self.message_type))


@pytest.fixture
def example(repository):
    """The example's own block, run for some steps as fast as possible."""
    folder = repository / "examples" / "dummy"
    config = load_yaml_core((folder / "dummy_new.yaml").read_text())

    def run(steps, listeners=1):
        loaded = load_model(
            format_setting(config["robot"]["sim"]),
            keyframe=config["robot"]["params"]["ic_keyframe"],
            folder=folder,
            share_of=lambda _: None,
            warn=pytest.fail,
        )
        inbox = ControlInbox(field="u", size=loaded.model.nu, monotonic_s=lambda: 0.0)
        simulation = Simulation(loaded.model, inbox)
        simulation.reset(loaded.keyframe)
        publishers = {}

        def make_publisher(message_type, topic, depth):
            return publishers.setdefault(topic, _Publisher(message_type, topic, depth, listeners))

        Stepper(
            simulation,
            pace=None,
            clock=MonotonicClock(),
            outputs=outputs_of(
                simulation,
                loaded.config,
                OutputContext(
                    make_publisher=make_publisher,
                    warn=pytest.fail,
                    on_close=pytest.fail,
                    is_paced=False,
                ),
            ),
            stamp=lambda: simulation.time_ns,
            warn=pytest.fail,
            report=lambda _: None,
        ).run(lambda: simulation.steps >= steps)
        return publishers

    return run


def test_rates_are_exact_in_simulation_time(example):
    published = {topic: len(sent.messages) for topic, sent in example(500).items()}
    assert published == {
        "/obelisk/dummy/joint_encoders": 500,
        "/obelisk/dummy/obk_joint_encoders": 500,
        "/obelisk/dummy/imu": 250,
        "/obelisk/dummy/framepose": 250,
        "~/viz_geoms": 0,
        "obelisk/sim/mujoco_scene_viz": 0,
    }


def test_stamps_are_the_multiples_of_the_period(example):
    sent = example(20)
    stamps = [message.header.stamp.nanosec for message in sent["/obelisk/dummy/imu"].messages]
    assert stamps == [2_000_000 * number for number in range(1, 11)]


def test_markers_are_published_on_both_topics_every_second(example):
    sent = example(2_000)
    for topic in ("~/viz_geoms", "obelisk/sim/mujoco_scene_viz"):
        assert [len(message.markers) for message in sent[topic].messages] == [3, 3]


def test_both_joint_encoder_messages_have_the_same_values(example):
    sent = example(50)
    plain = sent["/obelisk/dummy/joint_encoders"].messages[-1]
    named = sent["/obelisk/dummy/obk_joint_encoders"].messages[-1]
    assert named.joint_names == ["joint1"]
    assert plain.y.tolist() == list(named.joint_pos)


def test_nothing_is_sampled_without_a_subscriber(example, monkeypatch):
    def fail(*_):
        pytest.fail("a message was made")

    monkeypatch.setattr(PackedMessage, "to_bytes", fail)
    assert not any(publisher.messages for publisher in example(1_500, listeners=0).values())
