from pathlib import Path

import pytest

from obelisk_spec.model import read_model_facts

ARM = Path(__file__).parents[2] / "cases/workspace/demo_model/mujoco/arm.xml"


@pytest.mark.mujoco
def test_facts_are_those_of_the_file() -> None:
    import mujoco

    facts = read_model_facts(mujoco.MjSpec.from_file(str(ARM)))
    assert facts.joints == {"free": "free", "hinge": "hinge", "ball": "ball"}
    assert facts.geoms == {"box": "box"}
    assert facts.sites == ("imu", "tip")
    assert facts.keyframes == ("home",)
    assert len(facts.actuators) == 1
    assert facts.timestep == 0.001
    assert facts.sensors["hinge_pos"].type == "jointpos"
    assert facts.sensors["hinge_pos"].joint_type == "hinge"
    assert (facts.sensors["tip_quat"].object_type, facts.sensors["tip_quat"].object_name) == (
        "site",
        "tip",
    )


@pytest.mark.mujoco
def test_actuators_have_the_units_that_the_model_determines() -> None:
    import mujoco

    model = """<mujoco>
      <worldbody><body>
        <joint name="hinge" type="hinge"/><joint name="slide" type="slide"/>
        <joint name="free" type="slide"/>
        <geom size="1"/><site name="site"/>
      </body></worldbody>
      <actuator>
        <motor name="motor" joint="hinge"/>
        <motor joint="free"/>
        <motor name="scaled" joint="hinge" gear="100"/>
        <position name="servo" joint="hinge" kp="20"/>
        <position name="rail" joint="slide" kp="20" kv="1"/>
        <velocity name="speed" joint="hinge" kv="2"/>
        <general name="general" joint="hinge" gainprm="3"/>
        <intvelocity name="integrated" joint="hinge" kp="1" actrange="-1 1"/>
        <motor name="thrust" site="site"/>
        <velocity joint="hinge" kv="1"/>
      </actuator>
    </mujoco>"""
    facts = read_model_facts(mujoco.MjSpec.from_string(model))
    assert [(actuator.name, actuator.unit) for actuator in facts.actuators] == [
        ("motor", "N m"),
        ("free", "N"),
        ("scaled", ""),
        ("servo", "rad"),
        ("rail", "m"),
        ("speed", "rad/s"),
        ("general", ""),
        ("integrated", ""),
        ("thrust", ""),
        ("", "rad/s"),
    ]


@pytest.mark.mujoco
def test_poses_are_those_of_the_compiled_model() -> None:
    import mujoco

    model = """<mujoco>
      <worldbody>
        <body>
          <freejoint name="base"/><geom size="1"/>
          <body>
            <body><joint name="far" ref="90"/><geom size="1"/></body>
            <joint name="near" type="slide" ref="0.5"/><geom size="1"/>
          </body>
          <body><joint name="ball" type="ball"/><geom size="1"/>
            <body><joint name="last"/><geom size="1"/></body>
          </body>
        </body>
      </worldbody>
      <keyframe>
        <key name="other" qpos="0 0 0 1 0 0 0 1 2 1 0 0 0 3"/>
        <key name="velocities" qvel="0 0 0 0 0 0 0 0 0 0 0 0"/>
      </keyframe>
    </mujoco>"""
    spec = mujoco.MjSpec.from_string(model)
    poses = read_model_facts(spec).poses
    compiled = spec.compile()
    joints = ("near", "far", "last")
    states = {"": compiled.qpos0} | {n: compiled.key(n).qpos for n in ("other", "velocities")}
    assert poses == {
        name: pytest.approx({joint: qpos[compiled.joint(joint).qposadr[0]] for joint in joints})
        for name, qpos in states.items()
    }
    assert poses["other"] == {"near": 1.0, "far": 2.0, "last": 3.0}
