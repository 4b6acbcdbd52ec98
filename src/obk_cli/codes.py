"""The one table of rules: what each code means, why it hurts, what to do.

Feeds findings (severity), `obk explain`, the documentation and the tests. Data only.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

__all__ = ["FAMILIES", "RULES", "Rule", "Severity", "rule_of"]

Severity = Literal["error", "warning", "info"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """One rule."""

    code: str
    severity: Severity
    title: str
    cause: str
    cure: str


FAMILIES: Mapping[str, str] = MappingProxyType(
    {
        "OBK0": "text",
        "OBK1": "schema",
        "OBK2": "graph",
        "OBK3": "model",
        "OBK4": "packages",
        "OBK5": "style",
    }
)

_TABLE: tuple[tuple[str, Severity, str, str, str], ...] = (
    (
        "OBK001",
        "error",
        "a file cannot be read",
        "The file is not there, is a folder, or may not be read.",
        "Check the path, relative to the folder you stand in, and the file's permissions.",
    ),
    (
        "OBK002",
        "error",
        "a file is not UTF-8",
        "The bytes are in another encoding, or the file is not text.",
        "Save the file as UTF-8.",
    ),
    (
        "OBK003",
        "error",
        "the text is not YAML",
        "Usual causes: a tab in the indentation, no space after a colon, lines of one block that "
        "start in different columns, an open quote or bracket.",
        "Mend the text at the place named, or just above it.",
    ),
    (
        "OBK004",
        "error",
        "a key stands twice in one mapping",
        "YAML would silently keep one of the two.",
        "Remove one, or make the two a list.",
    ),
    (
        "OBK005",
        "error",
        "a tag that would build an object",
        "A config holds plain values only, so that reading it can run nothing.",
        "Remove the tag.",
    ),
    (
        "OBK006",
        "error",
        "aliases expand to too much",
        "Aliases of aliases multiply; a small file can mean billions of values.",
        "Write the values out, or use fewer levels of aliases.",
    ),
    (
        "OBK007",
        "error",
        "a file is over 10 MiB",
        "No config is that long; it is most likely not the file that was meant.",
        "Name the config, or split it with `include:`.",
    ),
    (
        "OBK008",
        "error",
        "an included file cannot be read",
        "Paths of `include:` are relative to the file that includes.",
        "Mend the path.",
    ),
    (
        "OBK009",
        "error",
        "files include each other in a circle",
        "A file would have to be merged into itself.",
        "Remove one of the includes in the chain that is shown.",
    ),
    (
        "OBK010",
        "error",
        "an included file is not a mapping",
        "Only mappings can be merged into a config.",
        "Give the included file keys such as `control:` or `robot:`.",
    ),
    (
        "OBK011",
        "error",
        "an environment variable is not set",
        "`${NAME}` is replaced when the config is read, and nothing stands in for it.",
        "Set the variable, write a default as `${NAME:-text}`, or `$${` for a literal `${`.",
    ),
    (
        "OBK012",
        "error",
        "`--set` does not fit the config",
        "The path leads to nothing that could be set, or the option is not `path=value`.",
        "Write for example `--set robot[0].sim[0].time_step=0.001`.",
    ),
    (
        "OBK013",
        "error",
        "values are nested too deeply",
        "A config needs a dozen levels; this text has over a hundred.",
        "Remove the needless brackets or indentation.",
    ),
    (
        "OBK101",
        "error",
        "an unknown key",
        "The language has no such key here, so it would have no effect.",
        "Mend the spelling or remove it. The user's own values belong under `params`.",
    ),
    (
        "OBK102",
        "error",
        "a key is missing",
        "The mapping means nothing without it.",
        "Add the key.",
    ),
    (
        "OBK103",
        "error",
        "a value of the wrong kind",
        "For example text where a number is expected, or one value where a list is.",
        "Write a value of the kind that the message names.",
    ),
    (
        "OBK104",
        "error",
        "a value out of range",
        "Periods must be above 0, counts at least 1.",
        "Write a value within the range that the message names.",
    ),
    (
        "OBK105",
        "error",
        "a value that is not one of the allowed",
        "The key takes only the values that the message lists.",
        "Write one of them.",
    ),
    (
        "OBK106",
        "error",
        "a component without a name",
        "Neither `ros_parameter` nor `key` says which component of the code is meant.",
        "Add the `ros_parameter` that the code declares, or the component's `key`.",
    ),
    (
        "OBK107",
        "error",
        "`ros_parameter` and `key` name different components",
        "The key is that of another component of the node.",
        "Remove one of the two, or make them agree.",
    ),
    (
        "OBK108",
        "error",
        "one component is configured twice",
        "Two entries of a node name the same component; only one could count.",
        "Remove one, or give it the name of the component that was meant.",
    ),
    (
        "OBK109",
        "error",
        "not a topic name",
        "ROS takes letters, digits, `_` and `/`; no part may start with a digit.",
        "Rename the topic.",
    ),
    (
        "OBK110",
        "error",
        "not a node name or namespace",
        "ROS takes letters, digits and `_`; no part may start with a digit.",
        "Rename it.",
    ),
    (
        "OBK111",
        "error",
        "not a package name",
        "A ROS package name is letters, digits, `_` and `-`, and starts with a letter.",
        "Write the package's name, not its path.",
    ),
    (
        "OBK112",
        "error",
        "two spellings mixed",
        "Sections stand both at the top level and inside devices, so it is unclear on which "
        "device the former run.",
        "Move the sections of the top level into a device, for example `onboard:`.",
    ),
    (
        "OBK113",
        "error",
        "a parameter that ROS cannot hold",
        "ROS parameters are bool, int, float, text, and lists of one of these.",
        "Write a value of that kind; nested mappings become dotted names.",
    ),
    (
        "OBK114",
        "error",
        "not a config",
        "The file holds something else, such as a ray caster's settings.",
        "Name the config that uses this file.",
    ),
    (
        "OBK115",
        "error",
        "an unknown message type",
        "No Obelisk message and no common ROS one has this name.",
        "Mend the name, or write the package too, `my_msgs/MyMessage`.",
    ),
    (
        "OBK201",
        "error",
        "a required section has no node",
        "Every stack needs a controller, an estimator and a robot.",
        "Add a node to the section, or include the file that has it.",
    ),
    (
        "OBK202",
        "error",
        "two nodes with one name",
        "ROS lets both run, and every request by name reaches either of them.",
        "Give one of them another `name` or `namespace`.",
    ),
    (
        "OBK203",
        "error",
        "a subscriber without a publisher",
        "Nothing in the config publishes the topic, so the subscriber would wait for ever.",
        "Mend the topic; if a node outside the config publishes it, silence the rule.",
    ),
    (
        "OBK204",
        "info",
        "published and never read",
        "Nothing in the config subscribes to the topic.",
        "Nothing, if a tool or another stack reads it.",
    ),
    (
        "OBK205",
        "error",
        "publisher and subscriber of different types",
        "ROS connects the two ends of a topic only where their message types are the same.",
        "Make the types the same, or use two topics.",
    ),
    (
        "OBK206",
        "error",
        "QoS that cannot match",
        "A subscriber that asks for more than the publisher offers receives nothing.",
        "Make the publisher `reliable` or `transient_local`, or the subscriber ask for less.",
    ),
    (
        "OBK207",
        "error",
        "an undefined callback group",
        "The name is not among the node's `callback_groups`.",
        "Define the group in the node, or mend the name.",
    ),
    (
        "OBK208",
        "warning",
        "an unused callback group",
        "No component of the node is in the group.",
        "Remove it, or put components into it.",
    ),
    (
        "OBK215",
        "warning",
        "a sensor faster than the simulation",
        "A sensor is sampled after a step, so its period cannot be shorter than one.",
        "Make `dt` a multiple of the model's step, or lower `time_step`.",
    ),
    (
        "OBK300",
        "info",
        "model checks skipped",
        "MuJoCo is not installed in this Python.",
        "Install the `mujoco` package to have sensor, site and geom names checked.",
    ),
    (
        "OBK301",
        "error",
        "model not found",
        "The file is in none of the places where models are looked for.",
        "Mend `model_xml_path`, or name the package that holds the model as `robot_pkg`.",
    ),
    (
        "OBK302",
        "error",
        "the model is not MJCF",
        "MuJoCo cannot read the file; the message is MuJoCo's.",
        "Mend the model at the line that is shown.",
    ),
    (
        "OBK303",
        "error",
        "a sensor that is not in the model",
        "Every name in `sensor_names` must be a sensor of the model.",
        "Mend the name, or add the sensor to the model.",
    ),
    (
        "OBK304",
        "error",
        "a sensor of another type",
        "The model has a sensor of that name, but of another type.",
        "Write the model's type, or name the sensor that was meant.",
    ),
    (
        "OBK305",
        "error",
        "a sensor that the message cannot carry",
        "The message has no field for what this sensor or ray pattern measures.",
        "Move it into a sensor group whose message has one.",
    ),
    (
        "OBK306",
        "error",
        "too many sensors or too few",
        "The message has room for a certain number of sensors of each type.",
        "Give as many as the message takes.",
    ),
    (
        "OBK307",
        "info",
        "a message only partly filled",
        "A sensor that the message has fields for is not given.",
        "Add the sensor, or nothing, if nobody reads those fields.",
    ),
    (
        "OBK308",
        "error",
        "sensors at different places",
        "One message describes one place of the robot; its sensors sit at several.",
        "Name sensors of one site or object.",
    ),
    (
        "OBK309",
        "error",
        "a joint sensor on a ball or free joint",
        "Joint encoders measure one number per joint.",
        "Name a sensor of a hinge or slide joint.",
    ),
    (
        "OBK310",
        "error",
        "a keyframe that is not in the model",
        "`ic_keyframe` names the state from which the simulation starts.",
        "Mend the name, or add the keyframe to the model.",
    ),
    (
        "OBK311",
        "error",
        "a geom that is not in the model",
        "Every name in `viz_geoms` must be a geom of the model.",
        "Mend the name, or name the geom in the model.",
    ),
    (
        "OBK312",
        "error",
        "a geom of another type",
        "The model has a geom of that name, but of another type.",
        "Write the model's type.",
    ),
    (
        "OBK313",
        "error",
        "a ray caster's site is not in the model",
        "Rays start at a site of the model.",
        "Mend `site_name`, or add the site to the model.",
    ),
    (
        "OBK314",
        "error",
        "a geom group out of range",
        "MuJoCo has the geom groups 0 to 5.",
        "Write a group from 0 to 5.",
    ),
    (
        "OBK316",
        "warning",
        "a coarse simulation step",
        "Steps over 0.02 s make most models unstable.",
        "Use a shorter `time_step`.",
    ),
    (
        "OBK318",
        "warning",
        "files of the model are missing",
        "Meshes or textures are not where the model says; its structure was still checked.",
        "Put the files there, or mend the model's `meshdir` and `texturedir`.",
    ),
    (
        "OBK319",
        "error",
        "a message that no sensor group can publish",
        "The simulator fills only the messages that the message lists.",
        "Write one of them.",
    ),
    (
        "OBK401",
        "error",
        "a package is not found",
        "It is not in the workspace, not in the Python environment, not on AMENT_PREFIX_PATH.",
        "Mend the name, put the package into the workspace, or source the one that has it.",
    ),
    (
        "OBK402",
        "error",
        "an executable is not in its package",
        "The package is there, but it has no executable of that name.",
        "Mend the name, or add the entry point to the package.",
    ),
    (
        "OBK403",
        "error",
        "a model package is not found",
        "`robot_pkg` is searched in the workspace, the Python environment and AMENT_PREFIX_PATH.",
        "Mend the name, or put the package into the workspace.",
    ),
    (
        "OBK404",
        "warning",
        "a file that the config names is missing",
        "The path is handed to a node, which may not start without it.",
        "Mend the path.",
    ),
    (
        "OBK501",
        "info",
        "an older name of a key",
        "It is read as the newer one.",
        "Write the newer name.",
    ),
    (
        "OBK503",
        "warning",
        "`n_u` is not the model's",
        "`n_u` is a legacy key; the number of controls comes from the model.",
        "Leave `n_u` out.",
    ),
    (
        "OBK504",
        "warning",
        "`time_step` is not the model's",
        "The config overrides the step that the model was tuned with.",
        "Make the two agree if that was not intended.",
    ),
    (
        "OBK505",
        "info",
        "a list that mixes int and float",
        "ROS lists hold one type; the whole list is read as floats.",
        "Write every number with a decimal point.",
    ),
    (
        "OBK506",
        "info",
        "a key without effect",
        "It is read for the sake of older configs.",
        "Remove it.",
    ),
)

RULES: Mapping[str, Rule] = MappingProxyType(
    {
        code: Rule(code=code, severity=severity, title=title, cause=cause, cure=cure)
        for code, severity, title, cause, cure in _TABLE
    }
)
"""Code -> rule, in the order of the codes."""


def rule_of(code: str) -> Rule:
    """The rule of a code that the tool itself reports.

    Raises:
        KeyError: no rule has that code.
    """
    return RULES[code]
