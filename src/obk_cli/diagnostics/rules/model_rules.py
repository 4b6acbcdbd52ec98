"""OBK3xx: the simulated robot against its model. Data only."""

from obk_cli.diagnostics.rules.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK300",
        severity="info",
        title="model checks skipped",
        cause="MuJoCo is not installed in this Python environment.",
        fix="Install the `mujoco` package to enable checks of sensor, site and geom names.",
    ),
    Rule(
        code="OBK301",
        severity="error",
        title="model not found",
        cause="The file was not found in any of the folders searched for models.",
        fix="Correct `model_xml_path`, or set `robot_pkg` to the package that contains it.",
    ),
    Rule(
        code="OBK302",
        severity="error",
        title="MuJoCo cannot load or simulate the model",
        cause="Either MuJoCo cannot read the file, and the message shows its error, or the time "
        "step is not a positive number.",
        fix="Fix the model at the reported line.",
    ),
    Rule(
        code="OBK303",
        severity="error",
        title="a sensor that is not in the model",
        cause="Every name in `sensor_names` must be a sensor in the model.",
        fix="Correct the name, or add the sensor to the model.",
    ),
    Rule(
        code="OBK304",
        severity="error",
        title="a sensor of the wrong type",
        cause="The model has a sensor of that name, but of another type.",
        fix="Use the type from the model, or the name of the intended sensor.",
    ),
    Rule(
        code="OBK305",
        severity="error",
        title="a sensor that does not fit the message",
        cause="The message has no field for the values of this sensor or ray pattern.",
        fix="Move it into a sensor group whose message has such a field.",
    ),
    Rule(
        code="OBK306",
        severity="error",
        title="wrong number of sensors",
        cause="The message type holds readings of a fixed number of sensors of each type.",
        fix="Configure as many sensors as the message type has room for.",
    ),
    Rule(
        code="OBK307",
        severity="info",
        title="a partly filled message",
        cause="The message has fields for a sensor that is not configured.",
        fix="Add the sensor. No change is needed if no node reads those fields.",
    ),
    Rule(
        code="OBK308",
        severity="error",
        title="sensors at different locations",
        cause="A message describes a single location on the robot, but the group's sensors are at "
        "several.",
        fix="Use sensors on the same site or object.",
    ),
    Rule(
        code="OBK309",
        severity="error",
        title="a joint sensor on a ball or free joint",
        cause="Joint encoders measure one value per joint.",
        fix="Use a sensor on a hinge or slide joint, and remove this one from the model: MuJoCo "
        "does not load a model that has it.",
    ),
    Rule(
        code="OBK310",
        severity="error",
        title="a keyframe that is not in the model",
        cause="`ic_keyframe` names the initial state of the simulation.",
        fix="Correct the name, or add the keyframe to the model.",
    ),
    Rule(
        code="OBK311",
        severity="warning",
        title="a geom that is not in the model",
        cause="`viz_geoms` names geoms in the model. The simulator logs unknown ones once and "
        "shows the rest.",
        fix="Correct the name, or give the geom this name in the model.",
    ),
    Rule(
        code="OBK312",
        severity="error",
        title="a geom of the wrong type",
        cause="The model has a geom of that name, but of another type.",
        fix="Use the type from the model.",
    ),
    Rule(
        code="OBK313",
        severity="error",
        title="a ray caster's site or frame that is not in the model",
        cause="Rays start at a site in the model. With `points_in: frame`, the points of a cloud "
        "are given in `frame`: `world`, or a site, body, geom or camera in the model. "
        "Otherwise, `frame` is only a label.",
        fix="Correct `site_name` or `frame`, or add the site to the model.",
    ),
    Rule(
        code="OBK314",
        severity="error",
        title="a geom group out of range",
        cause="MuJoCo has the geom groups 0 to 5.",
        fix="Write a group from 0 to 5.",
    ),
    Rule(
        code="OBK315",
        severity="error",
        title="a command that the simulator cannot apply",
        cause="The simulator writes the message's `u_mujoco` to the actuators, but this message "
        "type has no such field. The finding is a warning if the code of the controller sets the "
        "gains `kp` or `kd` of a `PDFeedForward`: the simulator turns them into torques, for which "
        "each joint must have one actuator.",
        fix="Subscribe the robot to `PositionSetpoint` or `PDFeedForward`. To use gains, remove "
        "all but one of the joint's actuators.",
    ),
    Rule(
        code="OBK316",
        severity="warning",
        title="a coarse simulation step",
        cause="Steps over 0.02 s make most models unstable.",
        fix="Use a shorter `time_step`.",
    ),
    Rule(
        code="OBK317",
        severity="warning",
        title="a command of the wrong length",
        cause="The controller writes a list of fixed length into the control message, but the "
        "model has a different number of actuators. The simulator rejects such messages. "
        "Controllers that publish commands to several topics are not checked.",
        fix="Write one value per actuator, in the order of the model.",
    ),
    Rule(
        code="OBK318",
        severity="warning",
        title="the model refers to missing files",
        cause="Meshes or textures were not found at the paths in the model. Only the structure "
        "of the model was checked.",
        fix="Add the files, or correct `meshdir` and `texturedir` in the model.",
    ),
    Rule(
        code="OBK319",
        severity="error",
        title="a message that no sensor group can publish",
        cause="The simulator can only publish certain message types, which the finding lists.",
        fix="Use one of the types that the message lists.",
    ),
    Rule(
        code="OBK320",
        severity="warning",
        title="commands of 0 move the robot to position 0",
        cause="When commands stop, `stale_action: zero` (the default) sets the control of every "
        "actuator to 0. For a position servo this is position 0, and the robot moves "
        "there with full force.",
        fix="Set `stale_action: hold` or `damp`. If position 0 is safe, silence the rule.",
    ),
    Rule(
        code="OBK321",
        severity="error",
        title="a simulator without its `sim` block",
        cause="`obelisk_mujoco_robot` reads its model and sensors from the `sim` block whose "
        "`ros_parameter` is `mujoco_setting` (the default), and cannot be configured without it.",
        fix="Add a `sim` block without a `ros_parameter`, or correct the executable.",
    ),
    Rule(
        code="OBK322",
        severity="error",
        title="a network that does not match the node's parameters",
        cause="The ROS parameters of a policy node describe what its network observes and "
        "commands: the terms of `observation`, `joints` and `action_joints`. The network in "
        "`params_path` takes or returns a different number of values, or the model has no such "
        "joint.",
        fix="List the terms and joints that the network was trained with, in the same order.",
    ),
)
