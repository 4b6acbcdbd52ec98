"""Rules about the config file itself: OBK0xx text, OBK1xx keys and values, OBK5xx style."""

from obk_cli.diagnostics.rules.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK001",
        severity="error",
        title="a file cannot be read",
        cause="The file does not exist, is a folder, or is not readable.",
        fix="Check the path, which is relative to the current folder, and the file's permissions.",
    ),
    Rule(
        code="OBK002",
        severity="error",
        title="a file is not UTF-8",
        cause="The bytes are in another encoding, or the file is not text.",
        fix="Save the file as UTF-8.",
    ),
    Rule(
        code="OBK003",
        severity="error",
        title="the file is not valid YAML",
        cause="Usual causes: a tab in the indentation, no space after a colon, inconsistent "
        "indentation, an unclosed quote or bracket.",
        fix="Fix the text at the reported location, or just above it.",
    ),
    Rule(
        code="OBK004",
        severity="error",
        title="a duplicate key in a mapping",
        cause="YAML would silently keep one of the two.",
        fix="Remove one, or merge the two into a list.",
    ),
    Rule(
        code="OBK005",
        severity="error",
        title="a tag that would create an object, or does not fit its value",
        cause="A config contains only plain values, so that reading it cannot run code.",
        fix="Remove the tag, or write a value that fits it.",
    ),
    Rule(
        code="OBK006",
        severity="error",
        title="too many values",
        cause="All files of a config together may contain at most 150,000 values. An alias counts "
        "as all values that it stands for, because nested aliases in a small file can expand to "
        "billions.",
        fix="Use fewer levels of aliases, or write the values out. If the file is data and not "
        "a config, correct its path.",
    ),
    Rule(
        code="OBK007",
        severity="error",
        title="too much text",
        cause="A config and the files that it includes may total at most 10 MiB, before and after "
        "variables are expanded. At most 100 files can be included. A larger config probably "
        "includes the wrong file.",
        fix="Correct the path, or split the config.",
    ),
    Rule(
        code="OBK008",
        severity="error",
        title="an included file cannot be read",
        cause="Paths in `include:` are relative to the including file.",
        fix="Correct the path.",
    ),
    Rule(
        code="OBK009",
        severity="error",
        title="circular include",
        cause="A file cannot be merged into itself.",
        fix="Remove one of the includes in the reported chain.",
    ),
    Rule(
        code="OBK010",
        severity="error",
        title="an included file is not a mapping",
        cause="Only mappings can be merged into a config.",
        fix="Give the included file keys such as `control:` or `robot:`.",
    ),
    Rule(
        code="OBK011",
        severity="error",
        title="an environment variable is not set",
        cause="`${NAME}` is replaced when the config is read, but the variable has no value and no "
        "default.",
        fix="Set the variable, provide a default (`${NAME:-text}`), or write `$${` for a literal "
        "`${`.",
    ),
    Rule(
        code="OBK012",
        severity="error",
        title="invalid `--set` option",
        cause="The path does not exist in the config, or the option is not `path=value`.",
        fix="Write, for example, `--set robot[0].sim[0].time_step=0.001`.",
    ),
    Rule(
        code="OBK013",
        severity="error",
        title="values are nested too deeply",
        cause="A config needs about a dozen levels; this one has over a hundred.",
        fix="Remove unneeded brackets or indentation.",
    ),
    Rule(
        code="OBK014",
        severity="warning",
        title="an `ignore` without effect",
        cause="An `ignore` in a comment, in the config or on the command line has no effect. Its "
        "code is not the code of a rule, or the rule cannot be silenced because its findings "
        "make the config unusable.",
        fix="Correct the code. A prefix such as `OBK4` stands for all codes that start with it.",
    ),
    Rule(
        code="OBK016",
        severity="info",
        title="a fragment that another config includes",
        cause="Another config of the workspace includes this file. `obk validate` therefore does "
        "not report missing keys, nodes, publishers or subscribers, which the other config "
        "may define.",
        fix="Validate the config that includes it.",
    ),
    Rule(
        code="OBK101",
        severity="error",
        title="an unknown key",
        cause="This key is not valid here and would have no effect.",
        fix="Correct the spelling or remove the key. Your own values belong under `params`.",
    ),
    Rule(
        code="OBK102",
        severity="error",
        title="a key is missing",
        cause="The mapping is incomplete without it.",
        fix="Add the key.",
    ),
    Rule(
        code="OBK103",
        severity="error",
        title="a value of the wrong type",
        cause="For example, a string instead of a number, or a single value instead of a list.",
        fix="Write a value of the type that the message gives.",
    ),
    Rule(
        code="OBK104",
        severity="error",
        title="a value out of range",
        cause="Periods must be greater than 0 and fit in 64 bits as nanoseconds. Counts must be "
        "at least 1 and fit in 32 bits.",
        fix="Write a value within the range that the message gives.",
    ),
    Rule(
        code="OBK105",
        severity="error",
        title="a value that is not allowed",
        cause="The key accepts only the values that the message lists.",
        fix="Use one of these values.",
    ),
    Rule(
        code="OBK106",
        severity="error",
        title="a component without a name",
        cause="Neither `ros_parameter` nor `key` identifies the component in the code.",
        fix="Add the `ros_parameter` declared in the code, or the component's `key`.",
    ),
    Rule(
        code="OBK107",
        severity="error",
        title="`ros_parameter` and `key` name different components",
        cause="The key belongs to another component of the node, in the config or in the code, "
        "or is misspelled. A key of your own is fine, because the node can also look the component "
        "up by that key.",
        fix="Remove one of the two, or make them match.",
    ),
    Rule(
        code="OBK108",
        severity="error",
        title="a component is configured twice",
        cause="Several entries of a node refer to the same component. Several `sim` blocks for the "
        "same parameter are an error, and so is a parameter in `params` that other keys set too, "
        "because it would replace their settings. For other components the finding is a warning, "
        "because the node uses the first entry and ignores the others.",
        fix="Remove one, or correct the name of its component.",
    ),
    Rule(
        code="OBK109",
        severity="error",
        title="an invalid topic name",
        cause="A topic name consists of letters, digits, `_` and `/`; no part may start with a "
        "digit.",
        fix="Rename the topic.",
    ),
    Rule(
        code="OBK110",
        severity="error",
        title="an invalid node name or namespace",
        cause="A name consists of letters, digits and `_`; no part may start with a digit.",
        fix="Correct the name.",
    ),
    Rule(
        code="OBK111",
        severity="error",
        title="an invalid package name",
        cause="A ROS package name consists of letters, digits, `_` and `-`, and starts with a "
        "letter.",
        fix="Write the package's name, not its path.",
    ),
    Rule(
        code="OBK112",
        severity="error",
        title="mixed syntax: sections inside and outside devices",
        cause="Sections occur both at the top level and inside devices, so it is unclear which "
        "device runs the former.",
        fix="Move the top-level sections into a device, for example `onboard:`.",
    ),
    Rule(
        code="OBK113",
        severity="error",
        title="an invalid ROS parameter",
        cause="A ROS parameter is a bool, an int, a float, a string, or a list of one of these.",
        fix="Write a value of one of these types; nested mappings become dotted names.",
    ),
    Rule(
        code="OBK114",
        severity="error",
        title="not a config",
        cause="The file contains something else, such as the settings of a ray caster.",
        fix="Pass the config that uses this file.",
    ),
    Rule(
        code="OBK115",
        severity="error",
        title="an unknown message type",
        cause="Neither Obelisk nor the common ROS packages define this message. For a C++ node, "
        "which ignores `msg_type`, the finding is info-level.",
        fix="Correct the name, or include the package: `my_msgs/MyMessage`.",
    ),
    Rule(
        code="OBK501",
        severity="info",
        title="a deprecated key",
        cause="The key still works, but it has a newer name.",
        fix="Use the newer name.",
    ),
    Rule(
        code="OBK502",
        severity="warning",
        title="a path into a user's home directory",
        cause="The folder does not exist on other machines or for other users.",
        fix="Make the path relative to the config, name its package, or use `${HOME}`.",
    ),
    Rule(
        code="OBK503",
        severity="warning",
        title="`n_u` differs from the model's",
        cause="`n_u` is a legacy key; the number of controls comes from the model.",
        fix="Remove `n_u`.",
    ),
    Rule(
        code="OBK504",
        severity="warning",
        title="`time_step` differs from the model's",
        cause="The simulator uses the config's `time_step` instead of the step for which the "
        "model was tuned. The original Obelisk ignores `time_step` and uses the model's.",
        fix="Remove `time_step` to reproduce the original's results, or make the two values equal.",
    ),
    Rule(
        code="OBK505",
        severity="info",
        title="a list that mixes int and float",
        cause="A ROS list has one element type; the whole list is read as floats.",
        fix="Write every number with a decimal point.",
    ),
    Rule(
        code="OBK506",
        severity="info",
        title="a key without effect",
        cause="The key is accepted for compatibility with older configs, or another key "
        "overrides it.",
        fix="Remove it.",
    ),
    Rule(
        code="OBK507",
        severity="info",
        title="an explicit default",
        cause="The key repeats the default value. This is common and harmless.",
        fix="Optionally remove the key.",
    ),
)
