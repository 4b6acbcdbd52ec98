"""OBK1xx: keys, values, names. Data only."""

from obk_cli.diagnostics.rules.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK101",
        severity="error",
        title="an unknown key",
        cause="The language has no such key here, so it would have no effect.",
        cure="Mend the spelling or remove it. The user's own values belong under `params`.",
    ),
    Rule(
        code="OBK102",
        severity="error",
        title="a key is missing",
        cause="The mapping means nothing without it.",
        cure="Add the key.",
    ),
    Rule(
        code="OBK103",
        severity="error",
        title="a value of the wrong kind",
        cause="For example text where a number is expected, or one value where a list is.",
        cure="Write a value of the kind that the message names.",
    ),
    Rule(
        code="OBK104",
        severity="error",
        title="a value out of range",
        cause="Periods must be above 0, counts at least 1, and both no more than what is behind "
        "them can hold: 32 bits for counts, 64 bits of nanoseconds for periods.",
        cure="Write a value within the range that the message names.",
    ),
    Rule(
        code="OBK105",
        severity="error",
        title="a value that is not one of the allowed",
        cause="The key takes only the values that the message lists.",
        cure="Write one of them.",
    ),
    Rule(
        code="OBK106",
        severity="error",
        title="a component without a name",
        cause="Neither `ros_parameter` nor `key` says which component of the code is meant.",
        cure="Add the `ros_parameter` that the code declares, or the component's `key`.",
    ),
    Rule(
        code="OBK107",
        severity="error",
        title="`ros_parameter` and `key` name different components",
        cause="The key is that of another component of the node, in the config or in the code, or "
        "a misspelling of this one's. A name of your own is taken: the node finds the component "
        "by it too.",
        cure="Remove one of the two, or make them agree.",
    ),
    Rule(
        code="OBK108",
        severity="error",
        title="one component is configured twice",
        cause="Two entries of a node name the same component: the node uses the first and ignores "
        "the others, which is a warning. Two `sim` blocks for the same parameter are an error.",
        cure="Remove one, or give it the name of the component that you meant.",
    ),
    Rule(
        code="OBK109",
        severity="error",
        title="not a topic name",
        cause="ROS takes letters, digits, `_` and `/`; no part may start with a digit.",
        cure="Rename the topic.",
    ),
    Rule(
        code="OBK110",
        severity="error",
        title="not a node name or namespace",
        cause="ROS takes letters, digits and `_`; no part may start with a digit.",
        cure="Rename it.",
    ),
    Rule(
        code="OBK111",
        severity="error",
        title="not a package name",
        cause="A ROS package name is letters, digits, `_` and `-`, and starts with a letter.",
        cure="Write the package's name, not its path.",
    ),
    Rule(
        code="OBK112",
        severity="error",
        title="two spellings mixed",
        cause="Sections stand both at the top level and inside devices, so it is unclear on "
        "which device the former run.",
        cure="Move the sections of the top level into a device, for example `onboard:`.",
    ),
    Rule(
        code="OBK113",
        severity="error",
        title="a parameter that ROS cannot hold",
        cause="ROS parameters are bool, int, float, text, and lists of one of these.",
        cure="Write a value of that kind; nested mappings become dotted names.",
    ),
    Rule(
        code="OBK114",
        severity="error",
        title="not a config",
        cause="The file holds something else, such as a ray caster's settings.",
        cure="Name the config that uses this file.",
    ),
    Rule(
        code="OBK115",
        severity="error",
        title="an unknown message type",
        cause="No Obelisk message and no common ROS one has this name.",
        cure="Mend the name, or write the package too, `my_msgs/MyMessage`.",
    ),
)
