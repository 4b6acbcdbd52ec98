"""OBK4xx: packages, executables, files. Data only."""

from obk_cli.diagnostics.rules.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK401",
        severity="error",
        title="a package is not found",
        cause="It is not in the workspace, not in the Python environment, not on "
        "AMENT_PREFIX_PATH.",
        fix="Correct the name, put the package into the workspace, or source the one that has it.",
    ),
    Rule(
        code="OBK402",
        severity="error",
        title="an executable is not in its package",
        cause="The package is there, but it has no executable of that name.",
        fix="Correct the name, or add the entry point to the package.",
    ),
    Rule(
        code="OBK403",
        severity="error",
        title="the package of a model or description is not found",
        cause="`robot_pkg` is searched in the workspace, the Python environment and "
        "AMENT_PREFIX_PATH.",
        fix="Correct the name, or put the package into the workspace.",
    ),
    Rule(
        code="OBK404",
        severity="warning",
        title="a file that the config names is missing",
        cause="The path is handed to a node, which may not start without it.",
        fix="Correct the path.",
    ),
    Rule(
        code="OBK405",
        severity="error",
        title="a component of the code that the config lacks",
        cause="The node's class registers it, and the node cannot be configured without its "
        "settings. One that the code calls optional is only mentioned.",
        fix="Add the component to the node, or register it with `required=False`.",
    ),
    Rule(
        code="OBK406",
        severity="error",
        title="a component that no code registers",
        cause="The node's class has no component of this name, so the entry would have no effect.",
        fix="Write the name that the code registers, or remove the entry.",
    ),
    Rule(
        code="OBK407",
        severity="error",
        title="`msg_type` differs between config and code",
        cause="The node's class registers the component with another message class.",
        fix="Write the type of the code, or leave `msg_type` out.",
    ),
    Rule(
        code="OBK408",
        severity="error",
        title="an abstract method is left out",
        cause="Python makes no object of a class that does not implement every abstract method.",
        fix="Write the method.",
    ),
    Rule(
        code="OBK409",
        severity="info",
        title="a parameter that no code declares",
        cause="ROS hands a node only the parameters that it declares; this one is dropped.",
        fix="Correct the name, or declare the parameter in the node's constructor.",
    ),
    Rule(
        code="OBK410",
        severity="error",
        title="the node's source cannot be run",
        cause="The file is not Python, or what the entry point names is not in it.",
        fix="Fix the source at the place that is shown, or the entry point in `setup.py`.",
    ),
    Rule(
        code="OBK411",
        severity="error",
        title="the package of a message type is not found",
        cause="It is not in the workspace, not in the Python environment, not on "
        "AMENT_PREFIX_PATH.",
        fix="Correct the name, put the message package into the workspace, or source the one that "
        "has it.",
    ),
    Rule(
        code="OBK412",
        severity="error",
        title="a parameter of another kind than the code declares",
        cause="A ROS parameter keeps to the kind of its default: a node that declares a float and "
        "is given an int, `2` for `2.0`, does not start.",
        fix="Write the value as the code declares it, or declare the parameter with "
        "`ParameterDescriptor(dynamic_typing=True)`.",
    ),
    Rule(
        code="OBK413",
        severity="warning",
        title="a message package that replaces one of Obelisk's",
        cause="A package of the workspace has the name of one of Obelisk's message packages, of "
        "another release. All nodes use it, and it lacks messages or fields. If the stack uses "
        "none of them, the finding is an info.",
        fix="Add what is missing to the package, or remove the package from the workspace.",
    ),
)
