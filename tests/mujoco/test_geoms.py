"""Markers of geoms: kind, full-length sizes, pose, color."""

import mujoco
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import Marker, MarkerArray

from obelisk_py.core.sim.mujoco.geoms import marker_sampler

pytestmark = pytest.mark.mujoco


@pytest.fixture
def markers(everything, moving):
    def make(**geoms):
        sampler = marker_sampler(everything, moving, geoms)
        sampler.take()
        return deserialize_message(sampler.message.to_bytes(5_000_000_000), MarkerArray).markers

    return make


@pytest.mark.parametrize(
    ("geom", "kind", "marker_type", "scale"),
    [
        ("shelf", "box", Marker.CUBE, (0.2, 0.4, 0.6)),
        ("foot", "sphere", Marker.SPHERE, (0.08, 0.08, 0.08)),
        ("thigh", "cylinder", Marker.CYLINDER, (0.06, 0.06, 0.2)),
        ("trunk", "ellipsoid", Marker.SPHERE, (0.4, 0.2, 0.1)),
    ],
)
def test_sizes_are_full_lengths(markers, moving, geom, kind, marker_type, scale):
    (marker,) = markers(**{geom: kind})
    assert (marker.type, marker.action) == (marker_type, Marker.ADD)
    assert (marker.header.frame_id, marker.header.stamp.sec) == ("world", 5)
    assert (marker.scale.x, marker.scale.y, marker.scale.z) == pytest.approx(scale)
    position = marker.pose.position
    assert [position.x, position.y, position.z] == moving.geom(geom).xpos.tolist()
    turn = marker.pose.orientation
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, [turn.w, turn.x, turn.y, turn.z])
    assert np.allclose(rotation, moving.geom(geom).xmat, atol=1e-12)


def test_a_capsule_is_a_cylinder_with_a_ball_at_each_end(markers):
    body, *balls = markers(rod="capsule")
    assert body.type == Marker.CYLINDER
    assert (body.scale.x, body.scale.z) == pytest.approx((0.1, 0.8))
    assert [ball.type for ball in balls] == [Marker.SPHERE] * 2
    for ball in balls:
        assert (ball.scale.x, ball.scale.y, ball.scale.z) == pytest.approx((0.1, 0.1, 0.1))
    # The rod lies along the world's x axis.
    assert [ball.pose.position.x for ball in balls] == pytest.approx([-0.6, -1.4])
    assert [ball.pose.position.z for ball in balls] == pytest.approx([1.0, 1.0])


def test_every_marker_has_its_own_number(markers):
    made = markers(rod="capsule", shelf="box", foot="sphere")
    assert [marker.id for marker in made] == [0, 1, 2, 3, 4]
    assert {marker.ns for marker in made} == {"mujoco"}


@pytest.mark.parametrize(
    ("geom", "kind", "colour"),
    [
        ("shelf", "box", (0.0, 1.0, 0.0, 1.0)),
        ("rod", "capsule", (1.0, 0.0, 0.0, 0.5)),
        ("foot", "sphere", (0.5, 0.5, 0.5, 1.0)),
    ],
)
def test_the_color_is_the_geoms_own_or_its_materials(markers, geom, kind, colour):
    marker = markers(**{geom: kind})[0]
    painted = (marker.color.r, marker.color.g, marker.color.b, marker.color.a)
    assert painted == pytest.approx(colour)
