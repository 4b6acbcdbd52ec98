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
    assert facts.actuators == 1
    assert facts.timestep == 0.001
    assert facts.sensors["hinge_pos"].type == "jointpos"
    assert facts.sensors["hinge_pos"].joint_type == "hinge"
    assert (facts.sensors["tip_quat"].object_type, facts.sensors["tip_quat"].object_name) == (
        "site",
        "tip",
    )
