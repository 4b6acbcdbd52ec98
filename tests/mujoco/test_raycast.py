"""Ray casters: ray layouts, and distances compared with MuJoCo and closed forms."""

import math

import mujoco
import numpy as np
import pytest

from obelisk_py.core.sim.mujoco.raycast import HeightScan, lay_out, make_caster, typed_ray_caster

from .groups import group, taken

pytestmark = pytest.mark.mujoco

SINGLE = 1e-6
"""Relative error of a value, because messages have 32 bits."""

SCENE = """
<mujoco model="scene">
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <geom name="ball" type="sphere" pos="3 0 1" size="0.5" group="1"/>
    <site name="post" pos="0 0 1"/>
    <body name="cart" pos="0 0 1">
      <freejoint/>
      <geom name="shell" type="sphere" size="0.2"/>
      <site name="eye" pos="0.05 0 0"/>
      <body name="mast" pos="0 0 0.6">
        <geom name="top" type="sphere" size="0.1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""

HEIGHT = {
    "type": "height_scan",
    "resolution": 0.1,
    "size": [0.6, 0.4],
    "offset": {"pos": [0.1, -0.2, 3.0], "rot": [0.9, 0.1, -0.2, 0.4]},
}
LIDAR = {
    "type": "lidar_scan",
    "channels": 9,
    "vertical_fov_range": [-60.0, 30.0],
    "horizontal_fov_range": [0.0, 360.0],
    "horizontal_res": 12.0,
    "offset": {"pos": [0.02, 0.0, 0.1], "rot": [0.7, 0.1, 0.3, -0.2]},
}
CAMERA = {
    "type": "depth_camera",
    "width": 16,
    "height": 12,
    "intrinsic_matrix": [13.0, 0.5, 7.5, 0.0, 14.0, 5.5, 0.0, 0.0, 1.0],
    "offset": {"rot": [0.9, 0.0, 0.3, 0.0]},
}


def _settings(pattern, *, site="imu", **more):
    return typed_ray_caster({"site_name": site, "pattern": pattern, **more})


def _sample(model, data, kind, settings):
    return taken(kind, group(model, data, kind, rays=settings))


def _own_rays(model, data, settings, site_rotation):
    """Origins and directions, computed without the code under test except for the layout."""
    rays = lay_out(settings.pattern)
    site = data.site(settings.site)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, np.array(settings.offset_wxyz) / np.linalg.norm(settings.offset_wxyz))
    turn = turn.reshape(3, 3)
    rays_in_world = []
    for start, direction in np.broadcast(_rows(rays.starts), _rows(rays.directions)):
        rays_in_world.append(
            (
                site.xpos + site_rotation @ (np.array(settings.offset_m) + turn @ start),
                site_rotation @ turn @ direction,
            )
        )
    return rays_in_world


def _rows(vectors):
    rows = np.empty(len(vectors), object)
    rows[:] = list(vectors)
    return rows


def _level(data, site):
    rotation = data.site(site).xmat.reshape(3, 3)
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    return np.array(
        [[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]]
    )


def _mj_ray(model, data, start, direction, *, exclude, groups=None, farthest=math.inf):
    distance = mujoco.mj_ray(
        model, data, start, direction, groups, 1, exclude, np.array([-1], np.int32)
    )
    return distance if 0 <= distance <= farthest else math.nan


def _same(numbers, wanted):
    numbers, wanted = np.asarray(numbers, np.float64), np.asarray(wanted)
    assert numbers.shape == wanted.shape
    assert np.array_equal(np.isnan(numbers), np.isnan(wanted))
    hits = ~np.isnan(wanted)
    assert hits.any()
    assert np.abs(numbers[hits] - wanted[hits]).max() <= SINGLE * max(1.0, wanted[hits].max())


DISTANCES = {**HEIGHT, "values": "distance"}


@pytest.mark.parametrize(
    "more", [{}, {"max_distance": 0.8}, {"geom_groups": []}, {"max_distance": 0.0}]
)
@pytest.mark.parametrize("pattern", [DISTANCES, LIDAR], ids=["height", "lidar"])
def test_distances_are_those_of_mj_ray(everything, moving, pattern, more):
    if pattern is DISTANCES and more.get("max_distance"):
        more = {"max_distance": 4.2}
    settings = _settings(pattern, **more)
    site = moving.site("imu")
    rotation = _level(moving, "imu") if pattern is DISTANCES else site.xmat.reshape(3, 3)
    groups = None if "geom_groups" in more else np.array([1, 0, 0, 0, 0, 0], np.uint8)
    wanted = [
        _mj_ray(
            everything,
            moving,
            start,
            direction,
            exclude=everything.body("base").id,
            groups=groups,
            farthest=more.get("max_distance") or math.inf,
        )
        for start, direction in _own_rays(everything, moving, settings, rotation)
    ]
    message = _sample(everything, moving, "ObkScan", settings)
    assert message.header.frame_id == "world"
    _same(message.data, wanted)


def test_a_depth_camera_reports_the_distance_along_its_axis(everything, moving):
    settings = _settings(CAMERA, geom_groups=[], frame="lens")
    rotation = moving.site("imu").xmat.reshape(3, 3)
    turned = np.empty(9)
    mujoco.mju_quat2Mat(turned, np.array(settings.offset_wxyz) / np.linalg.norm([0.9, 0.3]))
    axis = rotation @ turned.reshape(3, 3)[:, 0]
    wanted = [
        _mj_ray(everything, moving, start, direction, exclude=everything.body("base").id)
        * (direction @ axis)
        for start, direction in _own_rays(everything, moving, settings, rotation)
    ]
    message = _sample(everything, moving, "DepthImage", settings)
    assert (message.height, message.width, message.encoding) == (12, 16, "32FC1")
    assert message.step == 16 * 4
    assert message.header.frame_id == "lens", "a label, which the model need not have"
    _same(np.frombuffer(message.data, np.float32), wanted)


def test_the_scan_of_a_lidar_as_an_image_has_a_row_for_each_channel(everything, moving):
    image = _sample(everything, moving, "DepthImage", _settings(LIDAR))
    scan = _sample(everything, moving, "ObkScan", _settings(LIDAR))
    assert (image.height, image.width) == (9, 29)
    assert bytes(image.data) == scan.data.tobytes()


@pytest.fixture
def scene():
    return mujoco.MjModel.from_xml_string(SCENE)


@pytest.fixture
def still(scene):
    data = mujoco.MjData(scene)
    mujoco.mj_forward(scene, data)
    return data


def _along_plane_and_ball(start, direction):
    """Distance to the nearer of the plane z = 0 and the ball of the scene, in closed form."""
    down = -start[2] / direction[2] if direction[2] < 0 else math.inf
    to_ball = start - np.array([3.0, 0.0, 1.0])
    along = direction @ to_ball
    root = along**2 - (to_ball @ to_ball - 0.25)
    ball = -along - math.sqrt(root) if root >= 0 and -along > 0 else math.inf
    nearest = min(down, ball)
    return nearest if nearest < math.inf else math.nan


def test_a_lidar_hits_plane_and_ball_at_their_positions(scene, still):
    fine = {**LIDAR, "spacing": "exact", "channels": 41, "horizontal_res": 2.0, "offset": None}
    fine["vertical_fov_range"] = [-10.0, 30.0]
    settings = _settings(fine, site="eye", geom_groups=[0, 1])
    rays = _own_rays(scene, still, settings, np.eye(3))
    wanted = [_along_plane_and_ball(start, direction) for start, direction in rays]
    assert np.isnan(wanted).any()
    assert min(wanted) == pytest.approx(2.45, abs=0.01), "the ball is among them"
    mast = [_mj_ray(scene, still, s, d, exclude=1) for s, d in rays]
    seen = _sample(scene, still, "ObkScan", settings).data
    _same(seen, mast)
    free = [i for i, (s, d) in enumerate(rays) if d[2] <= 0.2]
    _same(np.array(seen)[free], np.array(wanted)[free])


STEPS_SCENE = """
<mujoco>
  <worldbody>
    <geom name="ground" type="plane" pos="0 0 0.2" size="0 0 1"/>
    <geom name="step" type="box" pos="0.5 0 0.3" size="0.3 2 0.2"/>
    <geom name="roof" type="box" pos="0 0 3" size="5 5 0.1" group="2"/>
    <body name="cart" pos="0 0 1.4" euler="10 20 90">
      <freejoint/>
      <geom type="sphere" size="0.05"/>
      <site name="eye"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def steps():
    """A ground at z = 0.2, a step with its top at z = 0.5 from x = 0.2 to 0.8, a roof above."""
    model = mujoco.MjModel.from_xml_string(STEPS_SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


ROW = {"type": "height_scan", "resolution": 0.5, "size": [0.0, 2.0], "direction": None}
"""As seen from the cart on the steps, whose heading is along y: x = 1.0, 0.5, 0.0, -0.5, -1.0."""


@pytest.mark.parametrize(
    ("more", "wanted"),
    [
        ({}, [0.2, 0.5, 0.2, 0.2, 0.2]),
        ({"values": "height"}, [0.2, 0.5, 0.2, 0.2, 0.2]),
        ({"values": "distance"}, [1.2, 0.9, 1.2, 1.2, 1.2]),
        ({"offset": {"pos": [0.0, 0.0, 1.0]}}, [0.2, 0.5, 0.2, 0.2, 0.2]),
        ({"offset": {"pos": [0.0, 0.0, 1.0]}, "values": "distance"}, [2.2, 1.9, 2.2, 2.2, 2.2]),
        ({"direction": [0.0, 0.0, -2.0]}, [0.2, 0.5, 0.2, 0.2, 0.2]),
        ({"direction": [0.0, 0.0, 1.0]}, [math.nan] * 5),
    ],
)
def test_a_height_scan_contains_the_z_of_each_hit(steps, more, wanted):
    model, data = steps
    message = _sample(model, data, "ObkScan", _settings({**ROW, **more}, site="eye"))
    assert list(message.data) == pytest.approx(wanted, nan_ok=True, abs=1e-6)


def test_a_height_scan_along_another_direction_still_contains_heights(steps):
    model, data = steps
    pattern = {"type": "height_scan", "resolution": 1.0, "size": [0.0, 0.0]}
    settings = _settings({**pattern, "direction": [0.0, 3.0, -3.0]}, site="eye")
    caster = make_caster(model, data, settings)
    caster.cast()
    assert caster.distances == pytest.approx([1.2 * math.sqrt(2.0)])
    assert _sample(model, data, "ObkScan", settings).data[0] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("groups", "wanted"),
    [
        ({}, math.nan),
        ({"geom_groups": None}, math.nan),
        ({"geom_groups": [0]}, math.nan),
        ({"geom_groups": [2]}, 2.9),
        ({"geom_groups": []}, 2.9),
    ],
)
def test_geoms_of_group_0_are_hit_unless_groups_are_given(steps, groups, wanted):
    model, data = steps
    up = {"type": "height_scan", "resolution": 1.0, "size": [0.0, 0.0], "direction": [0, 0, 1]}
    message = _sample(model, data, "ObkScan", _settings(up, site="eye", **groups))
    assert message.data[0] == pytest.approx(wanted, nan_ok=True)


def test_a_height_scan_stays_level_and_turns_with_the_heading(scene, still):
    cosine, sine = math.cos(math.pi / 4), math.sin(math.pi / 4)
    still.qpos[3:7] = [cosine, 0, 0, sine]
    tilt = np.array([math.cos(0.2), math.sin(0.2), 0, 0])
    mujoco.mju_mulQuat(still.qpos[3:7], still.qpos[3:7].copy(), tilt)
    mujoco.mj_forward(scene, still)
    pattern = {"type": "height_scan", "resolution": 1.0, "size": [2.0, 0.0]}
    caster = make_caster(scene, still, _settings(pattern, site="eye"))
    caster.cast()
    eye = still.site("eye").xpos
    assert caster.directions == pytest.approx(np.array([[0.0, 0.0, -1.0]]))
    assert caster.starts == pytest.approx(eye + np.array([[0, -1, 0], [0, 0, 0], [0, 1, 0]]))


def test_a_site_that_points_straight_up_has_the_heading_of_the_world(scene, still):
    half = math.cos(math.pi / 4)
    mujoco.mju_mulQuat(still.qpos[3:7], np.array([half, 0, 0, half]), np.array([half, 0, -half, 0]))
    mujoco.mj_forward(scene, still)
    pattern = {"type": "height_scan", "resolution": 1.0, "size": [1.0, 0.0]}
    caster = make_caster(scene, still, _settings(pattern, site="eye"))
    caster.cast()
    assert caster.starts[1] - caster.starts[0] == pytest.approx([1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("ordering", "first_three"),
    [
        ("xy", [[-0.1, -0.1, 0], [0, -0.1, 0], [0.1, -0.1, 0]]),
        ("yx", [[-0.1, -0.1, 0], [-0.1, 0, 0], [-0.1, 0.1, 0]]),
        (None, [[-0.1, -0.1, 0], [0, -0.1, 0], [0.1, -0.1, 0]]),
    ],
)
def test_the_ordering_names_the_axis_that_runs_faster_first(ordering, first_three):
    pattern = {"type": "height_scan", "resolution": 0.1, "size": [0.2, 0.2], "ordering": ordering}
    rays = lay_out(_settings(pattern).pattern)
    assert rays.starts[:3] == pytest.approx(np.array(first_three))
    assert len(rays.starts) == 9


def test_the_corpus_grid_has_a_ray_at_every_tenth_of_a_metre():
    pattern = {"type": "height_scan", "resolution": 0.1, "size": [1.6, 0.8]}
    rays = lay_out(_settings(pattern).pattern)
    assert (rays.rows, rays.columns) == (9, 17)
    assert rays.starts.min(axis=0) == pytest.approx([-0.8, -0.4, 0])
    assert rays.starts.max(axis=0) == pytest.approx([0.8, 0.4, 0])


def test_a_lidar_runs_to_the_left_within_a_channel_and_up_from_channel_to_channel():
    pattern = {
        "type": "lidar_scan",
        "channels": 3,
        "vertical_fov_range": [-45.0, 45.0],
        "horizontal_fov_range": [-90.0, 90.0],
        "horizontal_res": 60.0,
    }
    rays = lay_out(_settings(pattern).pattern)
    half = math.sqrt(0.5)
    assert (rays.rows, rays.columns) == (3, 3)
    assert rays.directions[:3] == pytest.approx(
        np.array([[0, -half, -half], [half, 0, -half], [0, half, -half]])
    )
    assert rays.directions[3:6] == pytest.approx(np.array([[0, -1, 0], [1, 0, 0], [0, 1, 0]]))


FLAT = {
    "type": "lidar_scan",
    "channels": 1,
    "vertical_fov_range": [0.0, 0.0],
    "horizontal_fov_range": [0.0, 360.0],
    "horizontal_res": 2.0,
}


def _angles_deg(pattern):
    directions = lay_out(_settings(pattern).pattern).directions
    return np.degrees(np.unwrap(np.arctan2(directions[:, 1], directions[:, 0])))


@pytest.mark.parametrize(
    ("more", "count", "last_deg"),
    [
        ({}, 179, 360 - 360 / 179),
        ({"spacing": "exact"}, 180, 358.0),
        ({"horizontal_fov_range": [-90.0, 90.0]}, 90, 90.0),
        ({"horizontal_fov_range": [-90.0, 90.0], "spacing": "exact"}, 91, 90.0),
        ({"horizontal_fov_range": [90.0, -90.0]}, 90, -90.0),
        ({"horizontal_fov_range": [0.0, 100.0], "horizontal_res": 30.0}, 4, 100.0),
        ({"horizontal_fov_range": [0.0, 1.0]}, 1, 0.0),
    ],
)
def test_the_columns_of_a_lidar_are_spread_over_its_range(more, count, last_deg):
    pattern = {**FLAT, **more}
    first_deg = pattern["horizontal_fov_range"][0]
    assert _angles_deg(pattern) == pytest.approx(np.linspace(first_deg, last_deg, count))


def test_the_rays_of_a_lidar_meet_a_wall_at_the_angles_of_its_columns():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><site name="eye" pos="0.5 0 1"/>
        <geom type="box" pos="3 0 1" size="0.5 40 1"/></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    seen = np.array(_sample(model, data, "ObkScan", _settings(FLAT, site="eye")).data)
    angles = np.radians(np.arange(179) * 360 / 179)
    ahead = np.cos(angles) > 0.06
    assert seen[ahead] == pytest.approx(2.0 / np.cos(angles[ahead]), rel=SINGLE)
    assert np.isnan(seen[np.cos(angles) <= 0]).all()


def test_the_middle_pixel_of_a_camera_looks_along_x_and_the_first_up_left():
    pattern = {
        "type": "depth_camera",
        "width": 3,
        "height": 3,
        "intrinsic_matrix": [1.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0],
        "rays_through": "centres",
    }
    rays = lay_out(_settings(pattern).pattern)
    assert rays.directions[4] == pytest.approx([1.0, 0.0, 0.0])
    assert rays.directions[0] == pytest.approx(np.array([1.0, 1.0, 1.0]) / math.sqrt(3))
    assert rays.directions[1] == pytest.approx(np.array([1.0, 0.0, 1.0]) / math.sqrt(2))


@pytest.mark.parametrize(
    ("through", "shift"), [(None, 0.5), ("corners", 0.5), ("centres", 0.0)], ids=str
)
def test_a_pixel_matches_the_ray_of_the_camera_matrix(through, shift):
    settings = _settings({**CAMERA, "rays_through": through})
    forward, left, up = lay_out(settings.pattern).directions.T
    matrix = np.array(CAMERA["intrinsic_matrix"]).reshape(3, 3)
    u, v, w = matrix @ np.stack([-left, -up, forward])
    columns, rows = np.arange(16.0) + shift, np.arange(12.0) + shift
    assert (u / w).reshape(12, 16) == pytest.approx(np.tile(columns, (12, 1)))
    assert (v / w).reshape(12, 16) == pytest.approx(np.tile(rows[:, None], (1, 16)))


@pytest.mark.parametrize(("through", "shift"), [(None, 0.5), ("centres", 0.0)], ids=str)
def test_a_depth_camera_hits_the_ground_along_its_pixels(through, shift):
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><site name="eye" pos="0 0 1"/>
        <geom type="plane" size="0 0 1"/></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = {
        "type": "depth_camera",
        "width": 1,
        "height": 4,
        "intrinsic_matrix": [10.0, 0.0, 0.0, 0.0, 10.0, -9.0, 0.0, 0.0, 1.0],
        "rays_through": through,
    }
    message = _sample(model, data, "DepthImage", _settings(camera, site="eye"))
    # A meter above the ground, row v meets it at a depth of 10 / (v + 9).
    rows = np.arange(4) + shift
    assert np.frombuffer(message.data, np.float32) == pytest.approx(10.0 / (rows + 9.0), rel=1e-6)


def test_rays_ignore_their_own_body_but_hit_other_bodies_of_the_robot(scene, still):
    up = {**LIDAR, "channels": 1, "vertical_fov_range": [90.0, 90.0], "offset": None}
    pattern = {**up, "horizontal_fov_range": [0.0, 0.0]}
    message = _sample(scene, still, "ObkScan", _settings(pattern, site="eye"))
    assert list(message.data) == pytest.approx([0.6 - math.sqrt(0.1**2 - 0.05**2)])


def test_a_site_of_the_world_sees_the_world(scene, still):
    pattern = {"type": "height_scan", "resolution": 1.0, "size": [0.0, 0.0]}
    pattern["offset"] = {"pos": [5.0, 0.0, 0.0]}
    message = _sample(scene, still, "ObkScan", _settings(pattern, site="post"))
    assert list(message.data) == [0.0]


def test_hits_beyond_the_maximum_distance_are_misses(scene, still):
    pattern = {"type": "height_scan", "resolution": 1.0, "size": [0.0, 0.0], "values": "distance"}
    near, far, unlimited = (
        _sample(scene, still, "ObkScan", _settings(pattern, site="eye", max_distance=d)).data[0]
        for d in (0.999, 1.001, 0.0)
    )
    assert math.isnan(near)
    assert far == unlimited == pytest.approx(1.0)
    high = {**pattern, "offset": {"pos": [5.0, 0.0, 5000.0]}}
    assert _sample(scene, still, "ObkScan", _settings(high, site="eye")).data[0] == 5001.0


def _points(message):
    assert [field.name for field in message.fields] == ["x", "y", "z", "intensity"]
    assert [field.offset for field in message.fields] == [0, 4, 8, 12]
    assert message.point_step == 16
    assert message.row_step == 16 * message.width
    assert len(message.data) == message.height * message.row_step
    numbers = np.frombuffer(message.data, np.float32).reshape(-1, 4)
    assert (numbers[:, 3] == 1.0).all()
    return numbers[:, :3].astype(np.float64)


FRAMES = {
    "world": lambda _data: (np.zeros(3), np.eye(3)),
    "toe": lambda data: (data.site("toe").xpos, data.site("toe").xmat.reshape(3, 3)),
    "left": lambda data: (data.body("left").xpos, data.body("left").xmat.reshape(3, 3)),
    "shelf": lambda data: (data.geom("shelf").xpos, data.geom("shelf").xmat.reshape(3, 3)),
    "imu": lambda data: (data.site("imu").xpos, data.site("imu").xmat.reshape(3, 3)),
}


def _hits(everything, moving, settings):
    """End points of the rays in the world; NaN for a miss."""
    site = moving.site("imu").xmat.reshape(3, 3)
    level = _level(moving, "imu") if isinstance(settings.pattern, HeightScan) else site
    rays = _own_rays(everything, moving, settings, level)
    body = everything.body("base").id
    return np.array([s + d * _mj_ray(everything, moving, s, d, exclude=body) for s, d in rays])


@pytest.mark.parametrize("frame", [*FRAMES, None])
@pytest.mark.parametrize("pattern", [HEIGHT, LIDAR], ids=["height", "lidar"])
def test_the_points_of_a_cloud_are_in_the_requested_frame(everything, moving, pattern, frame):
    settings = _settings(pattern, frame=frame, points_in="frame", keep_misses=True, geom_groups=[])
    message = _sample(everything, moving, "PointCloud2", settings)
    assert message.header.frame_id == (frame or "world")
    position, rotation = FRAMES[frame or "world"](moving)
    assert not message.is_dense
    rays = lay_out(settings.pattern)
    assert (message.height, message.width) == (rays.rows, rays.columns)
    _same(_points(message), (_hits(everything, moving, settings) - position) @ rotation)


@pytest.mark.parametrize("frame", [None, "toe", "no_such_thing"])
@pytest.mark.parametrize("pattern", [HEIGHT, LIDAR], ids=["height", "lidar"])
def test_a_cloud_is_of_hits_in_the_frame_of_the_site(everything, moving, pattern, frame):
    farthest = 4.2 if pattern is HEIGHT else 4.0
    settings = _settings(pattern, frame=frame, geom_groups=[], max_distance=farthest)
    message = _sample(everything, moving, "PointCloud2", settings)
    assert message.header.frame_id == (frame or "world"), "only a label"
    position, rotation = FRAMES["imu"](moving)
    hits = _hits(everything, moving, _settings(pattern, geom_groups=[]))
    caster = make_caster(everything, moving, settings)
    caster.cast()
    is_hit = np.isfinite(caster.distances)
    assert 0 < is_hit.sum() < len(is_hit)
    assert (message.height, message.width, message.is_dense) == (1, is_hit.sum(), True)
    _same(_points(message), (hits[is_hit] - position) @ rotation)


def test_the_number_of_hits_follows_the_simulation_and_may_be_0(steps):
    model, data = steps
    straight_ahead = {**FLAT, "horizontal_fov_range": [-20.0, 20.0]}
    sampler = group(model, data, "PointCloud2", rays=_settings(straight_ahead, site="eye"))
    counts = []
    for z in (0.3, 3.9, 0.4):
        data.qpos[:7] = [-1.0, 0.0, z, 1.0, 0.0, 0.0, 0.0]
        mujoco.mj_forward(model, data)
        message = taken("PointCloud2", sampler)
        points = _points(message)
        counts.append(len(points))
        assert message.width == len(points)
        assert points[:, 0] == pytest.approx(np.full(len(points), 1.2)), "the step's near side"
    assert counts == [20, 0, 20]


def test_scans_follow_the_simulation(everything, moving):
    sampler = group(everything, moving, "ObkScan", rays=_settings(LIDAR))
    before = taken("ObkScan", sampler).data
    mujoco.mj_step(everything, moving, 20)
    assert not np.array_equal(taken("ObkScan", sampler).data, before, equal_nan=True)
