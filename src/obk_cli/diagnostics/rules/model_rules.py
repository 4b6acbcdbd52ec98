"""OBK3xx: the simulated robot against its model. Data only."""

from obk_cli.diagnostics.rules.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK300",
        severity="info",
        title="model checks skipped",
        cause="MuJoCo is not installed in this Python.",
        fix="Install the `mujoco` package to have sensor, site and geom names checked.",
    ),
    Rule(
        code="OBK301",
        severity="error",
        title="model not found",
        cause="The file is in none of the places where models are looked for.",
        fix="Correct `model_xml_path`, or name the package that holds the model as `robot_pkg`.",
    ),
    Rule(
        code="OBK302",
        severity="error",
        title="the model is not MJCF",
        cause="MuJoCo cannot read the file; the message is MuJoCo's.",
        fix="Correct the model at the line that is shown.",
    ),
    Rule(
        code="OBK303",
        severity="error",
        title="a sensor that is not in the model",
        cause="Every name in `sensor_names` must be a sensor of the model.",
        fix="Correct the name, or add the sensor to the model.",
    ),
    Rule(
        code="OBK304",
        severity="error",
        title="a sensor of another type",
        cause="The model has a sensor of that name, but of another type.",
        fix="Write the model's type, or name the sensor that was meant.",
    ),
    Rule(
        code="OBK305",
        severity="error",
        title="a sensor that the message cannot carry",
        cause="The message has no field for what this sensor or ray pattern measures.",
        fix="Move it into a sensor group whose message has one.",
    ),
    Rule(
        code="OBK306",
        severity="error",
        title="too many sensors or too few",
        cause="The message has room for a certain number of sensors of each type.",
        fix="Give as many as the message takes.",
    ),
    Rule(
        code="OBK307",
        severity="info",
        title="a message only partly filled",
        cause="A sensor that the message has fields for is not given.",
        fix="Add the sensor, or change nothing if no node reads those fields.",
    ),
    Rule(
        code="OBK308",
        severity="error",
        title="sensors at different places",
        cause="One message describes one place of the robot; its sensors sit at several.",
        fix="Name sensors of one site or object.",
    ),
    Rule(
        code="OBK309",
        severity="error",
        title="a joint sensor on a ball or free joint",
        cause="Joint encoders measure one number per joint.",
        fix="Name a sensor of a hinge or slide joint.",
    ),
    Rule(
        code="OBK310",
        severity="error",
        title="a keyframe that is not in the model",
        cause="`ic_keyframe` names the state from which the simulation starts.",
        fix="Correct the name, or add the keyframe to the model.",
    ),
    Rule(
        code="OBK311",
        severity="warning",
        title="a geom that is not in the model",
        cause="`viz_geoms` names geoms of the model. The simulator logs the others once and shows "
        "the rest.",
        fix="Correct the name, or name the geom in the model.",
    ),
    Rule(
        code="OBK312",
        severity="error",
        title="a geom of another type",
        cause="The model has a geom of that name, but of another type.",
        fix="Write the model's type.",
    ),
    Rule(
        code="OBK313",
        severity="error",
        title="a ray caster's site or frame is not in the model",
        cause="Rays start at a site of the model. With `points_in: frame`, the points of a cloud "
        "are given in `frame`: `world`, or a site, body, geom or camera of the model. Without it, "
        "`frame` is a label.",
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
        title="a control that the simulator cannot apply",
        cause="The simulator writes the message's `u_mujoco` to the actuators; this message has "
        "no such field.",
        fix="Subscribe the robot to `PositionSetpoint` or `PDFeedForward`.",
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
        title="a control of the wrong length",
        cause="The controller's code writes a list of fixed length into the control message, and "
        "the model has another number of actuators; such a message is refused.",
        fix="Write one value for each actuator, in the order of the model.",
    ),
    Rule(
        code="OBK318",
        severity="warning",
        title="files of the model are missing",
        cause="Meshes or textures are not at the model's paths; its structure was still checked.",
        fix="Put the files there, or correct the model's `meshdir` and `texturedir`.",
    ),
    Rule(
        code="OBK319",
        severity="error",
        title="a message that no sensor group can publish",
        cause="The simulator fills only the messages that the message lists.",
        fix="Write one of them.",
    ),
    Rule(
        code="OBK320",
        severity="warning",
        title="zero where zero is a position",
        cause="When commands stop, `stale_action: zero`, which is also what is done where none is "
        "written, has every actuator get the control 0. To a position servo that is the position "
        "0, and the robot goes there with all its strength.",
        fix="Write `stale_action: hold` or `damp`. Where the position 0 is safe, silence this.",
    ),
    Rule(
        code="OBK321",
        severity="error",
        title="a simulator without its `sim` block",
        cause="`obelisk_mujoco_robot` reads its model and its sensors from the block of the "
        "parameter `mujoco_setting`, and cannot be configured without one.",
        fix="Add a `sim` block without a `ros_parameter`, or name the executable that was meant.",
    ),
)
