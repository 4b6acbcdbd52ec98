"""Rules about the config file itself: OBK0xx text, OBK1xx keys and values, OBK5xx style."""

from obk_cli.diagnostics.rules.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK001",
        severity="error",
        title="a file cannot be read",
        cause="The file is not there, is a folder, or may not be read.",
        fix="Check the path, relative to the folder you stand in, and the file's permissions.",
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
        title="the text is not YAML",
        cause="Usual causes: a tab in the indentation, no space after a colon, lines of one "
        "block that start in different columns, an open quote or bracket.",
        fix="Fix the text at the place named, or just above it.",
    ),
    Rule(
        code="OBK004",
        severity="error",
        title="a key stands twice in one mapping",
        cause="YAML would silently keep one of the two.",
        fix="Remove one, or make the two a list.",
    ),
    Rule(
        code="OBK005",
        severity="error",
        title="a tag that would build an object",
        cause="A config holds plain values only, so that reading it can run nothing.",
        fix="Remove the tag.",
    ),
    Rule(
        code="OBK006",
        severity="error",
        title="more values than a config has",
        cause="All files of a config together may hold 150,000 values, an alias counted as all "
        "that it stands for: aliases of aliases multiply, and a small file can mean billions.",
        fix="Use fewer levels of aliases, or write the values out; name the file that was meant "
        "if this one holds data and not a config.",
    ),
    Rule(
        code="OBK007",
        severity="error",
        title="more text than a config has",
        cause="All files of a config together may be 10 MiB long, as may what variables make of "
        "them, and 100 files be included. No config is longer; most likely one of the files is not "
        "the one that was meant.",
        fix="Name the file that was meant, or make several configs.",
    ),
    Rule(
        code="OBK008",
        severity="error",
        title="an included file cannot be read",
        cause="Paths of `include:` are relative to the file that includes.",
        fix="Correct the path.",
    ),
    Rule(
        code="OBK009",
        severity="error",
        title="files include each other in a circle",
        cause="A file would have to be merged into itself.",
        fix="Remove one of the includes in the chain that is shown.",
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
        cause="`${NAME}` is replaced when the config is read, and nothing stands in for it.",
        fix="Set the variable, write a default as `${NAME:-text}`, or `$${` for a literal `${`.",
    ),
    Rule(
        code="OBK012",
        severity="error",
        title="`--set` does not fit the config",
        cause="The path leads to nothing that could be set, or the option is not `path=value`.",
        fix="Write for example `--set robot[0].sim[0].time_step=0.001`.",
    ),
    Rule(
        code="OBK013",
        severity="error",
        title="values are nested too deeply",
        cause="A config needs a dozen levels; this text has over a hundred.",
        fix="Remove the needless brackets or indentation.",
    ),
    Rule(
        code="OBK014",
        severity="warning",
        title="what cannot be silenced",
        cause="An `ignore` in a comment, in the config or on the command line names no rule, or "
        "one whose findings leave no config to go on with, so it has no effect.",
        fix="Correct the code; the beginning of codes, such as `OBK4`, stands for all of them.",
    ),
    Rule(
        code="OBK016",
        severity="info",
        title="a fragment that another config includes",
        cause="Another config of the workspace includes this file, so `obk validate` does not "
        "report what the file lacks: keys, nodes, publishers and subscribers that the other "
        "config may have.",
        fix="Validate the config that includes it.",
    ),
    Rule(
        code="OBK101",
        severity="error",
        title="an unknown key",
        cause="The language has no such key here, so it would have no effect.",
        fix="Correct the spelling or remove it. The user's own values belong under `params`.",
    ),
    Rule(
        code="OBK102",
        severity="error",
        title="a key is missing",
        cause="The mapping means nothing without it.",
        fix="Add the key.",
    ),
    Rule(
        code="OBK103",
        severity="error",
        title="a value of the wrong kind",
        cause="For example text where a number is expected, or one value where a list is.",
        fix="Write a value of the kind that the message names.",
    ),
    Rule(
        code="OBK104",
        severity="error",
        title="a value out of range",
        cause="Periods must be above 0, counts at least 1, and both no more than what is behind "
        "them can hold: 32 bits for counts, 64 bits of nanoseconds for periods.",
        fix="Write a value within the range that the message names.",
    ),
    Rule(
        code="OBK105",
        severity="error",
        title="a value that is not one of the allowed",
        cause="The key takes only the values that the message lists.",
        fix="Write one of them.",
    ),
    Rule(
        code="OBK106",
        severity="error",
        title="a component without a name",
        cause="Neither `ros_parameter` nor `key` names the component of the code.",
        fix="Add the `ros_parameter` that the code declares, or the component's `key`.",
    ),
    Rule(
        code="OBK107",
        severity="error",
        title="`ros_parameter` and `key` name different components",
        cause="The key is that of another component of the node, in the config or in the code, or "
        "a misspelling of this one's. A name of your own is taken: the node finds the component "
        "by it too.",
        fix="Remove one of the two, or make them agree.",
    ),
    Rule(
        code="OBK108",
        severity="error",
        title="one component is configured twice",
        cause="Two entries of a node name the same component: the node uses the first and ignores "
        "the others, which is a warning. Two `sim` blocks for the same parameter are an error.",
        fix="Remove one, or give it the name of the component that you meant.",
    ),
    Rule(
        code="OBK109",
        severity="error",
        title="not a topic name",
        cause="ROS takes letters, digits, `_` and `/`; no part may start with a digit.",
        fix="Rename the topic.",
    ),
    Rule(
        code="OBK110",
        severity="error",
        title="not a node name or namespace",
        cause="ROS takes letters, digits and `_`; no part may start with a digit.",
        fix="Rename it.",
    ),
    Rule(
        code="OBK111",
        severity="error",
        title="not a package name",
        cause="A ROS package name is letters, digits, `_` and `-`, and starts with a letter.",
        fix="Write the package's name, not its path.",
    ),
    Rule(
        code="OBK112",
        severity="error",
        title="two spellings mixed",
        cause="Sections stand both at the top level and inside devices, so it is unclear on "
        "which device the former run.",
        fix="Move the sections of the top level into a device, for example `onboard:`.",
    ),
    Rule(
        code="OBK113",
        severity="error",
        title="a parameter that ROS cannot hold",
        cause="ROS parameters are bool, int, float, text, and lists of one of these.",
        fix="Write a value of that kind; nested mappings become dotted names.",
    ),
    Rule(
        code="OBK114",
        severity="error",
        title="not a config",
        cause="The file holds something else, such as a ray caster's settings.",
        fix="Name the config that uses this file.",
    ),
    Rule(
        code="OBK115",
        severity="error",
        title="an unknown message type",
        cause="No Obelisk message and no common ROS one has this name. It is an info for a node in "
        "C++, which ignores `msg_type`.",
        fix="Correct the name, or write the package too, `my_msgs/MyMessage`.",
    ),
    Rule(
        code="OBK501",
        severity="info",
        title="an older name of a key",
        cause="It is read as the newer one.",
        fix="Write the newer name.",
    ),
    Rule(
        code="OBK502",
        severity="warning",
        title="a path into one person's home",
        cause="On another machine, and for another person, there is no such folder.",
        fix="Write the path relative to the config, name its package, or use `${HOME}`.",
    ),
    Rule(
        code="OBK503",
        severity="warning",
        title="`n_u` is not the model's",
        cause="`n_u` is a legacy key; the number of controls comes from the model.",
        fix="Leave `n_u` out.",
    ),
    Rule(
        code="OBK504",
        severity="warning",
        title="`time_step` is not the model's",
        cause="The simulator uses the config's `time_step` instead of the step that the model was "
        "tuned with. The original Obelisk ignores `time_step` and uses the model's.",
        fix="Leave `time_step` out to get the original's numbers, or make the two agree.",
    ),
    Rule(
        code="OBK505",
        severity="info",
        title="a list that mixes int and float",
        cause="ROS lists hold one type; the whole list is read as floats.",
        fix="Write every number with a decimal point.",
    ),
    Rule(
        code="OBK506",
        severity="info",
        title="a key without effect",
        cause="The key is accepted for the sake of older configs, or another key leaves it nothing "
        "to decide.",
        fix="Remove it.",
    ),
    Rule(
        code="OBK507",
        severity="info",
        title="a default written out",
        cause="The key repeats the default; many configs do so, and it is harmless.",
        fix="Leave the key out, or leave it there.",
    ),
)
