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
        cause="The package is there, but it has no executable of that name, or none that can run: "
        "CMakeLists.txt declares it and it is not built, it is built and its workspace is not "
        "sourced, or its file has no execute bit.",
        fix="Correct the name, or add the entry point to the package. The help has the command "
        "that builds the package, sources its workspace or sets the execute bit.",
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
        "settings. It is a warning if the node only logs that it is missing, as in the API since "
        "2026-05, and an info if the code calls it optional.",
        fix="Add the component to the node, or register it with `required=False`.",
    ),
    Rule(
        code="OBK406",
        severity="error",
        title="a component that no code registers",
        cause="The node's class has no component of this name, so the entry would have no effect. "
        "It is an info if a simulator ignores what only its robot's hardware uses.",
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
        severity="warning",
        title="a parameter that no code declares",
        cause="A ROS node receives only the parameters that it declares, so this one is dropped. "
        "It is an info if no declared parameter has a similar name. If the code computes names of "
        "parameters, only a typo of a declared one that is not set is reported.",
        fix="Correct the name, or declare the parameter with `Parameter` in the node's class.",
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
        "is given an int, `2` for `2.0`, does not start. Only a float of `Parameter` takes an int.",
        fix="Write the value as the code declares it, or declare the parameter with `Parameter` or "
        "with `ParameterDescriptor(dynamic_typing=True)`.",
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
    Rule(
        code="OBK414",
        severity="error",
        title="a malformed package.xml",
        cause="The file is not well-formed XML, or it has no `<name>`; colcon does not build such "
        "a package, and other tools do not find it.",
        fix="Correct package.xml at the place that is shown.",
    ),
    Rule(
        code="OBK415",
        severity="error",
        title="a parameter beyond the limits that the code declares",
        cause="The node's class declares the parameter with `Parameter`, with limits or with the "
        "members of an enum: a node that is given another value does not start.",
        fix="Write a value within the limits, or change `ge` and `le` in the code.",
    ),
    Rule(
        code="OBK420",
        severity="error",
        title="a name that the source does not define",
        cause="A class was renamed, or an import is missing: Python raises a `NameError` when it "
        "reaches the name. In a method it is a warning. Names in a `try` with handlers are not "
        "checked, nor are modules that use `import *` or `exec`.",
        fix="Write the name that the module defines, or import it.",
    ),
    Rule(
        code="OBK421",
        severity="error",
        title="an import that fails",
        cause="The package is not installed in the Python environment of `obk`, the module does "
        "not exist, or it does not define the name. Only imports that run whenever the node "
        "starts are checked, not those in `try`, `if` or other functions.",
        fix="Correct the name, or install the package. If the node can run without it, import it "
        "within `try: ... except ImportError: ...`.",
    ),
    Rule(
        code="OBK422",
        severity="error",
        title="`super().__init__` is missing",
        cause="The constructor of the base class makes the ROS node and registers its components; "
        "nothing works before it has run.",
        fix="Begin the constructor with `super().__init__(node_name)`.",
    ),
    Rule(
        code="OBK423",
        severity="error",
        title="a key that no component has",
        cause="`obk_publishers`, `obk_subscriptions` and `obk_timers` contain the components that "
        "the class registers; another key raises a `KeyError`.",
        fix="Write the key of a registered component, or register one with this key.",
    ),
    Rule(
        code="OBK424",
        severity="error",
        title="a callback that the class does not have",
        cause="Python raises an `AttributeError` when the component is registered.",
        fix="Write the name of the method.",
    ),
    Rule(
        code="OBK425",
        severity="error",
        title="a component without a message type",
        cause="Neither the config nor the node's class gives it, so the node cannot be configured.",
        fix="Add `msg_type` to the component, or pass the message class when registering it.",
    ),
    Rule(
        code="OBK426",
        severity="warning",
        title="a callback that waits for its own executor",
        cause="One thread runs all callbacks of a node. `client.call(...)` in a callback waits for "
        "an answer that this thread would have to receive: the node hangs. "
        "`rclpy.spin_until_future_complete(self, ...)` takes the node from the executor that runs "
        "it, which runs none of its callbacks afterwards.",
        fix="Write `await client.call_async(...)` in an `async def` callback, or continue in a "
        "callback of the future: `client.call_async(...).add_done_callback(...)`.",
    ),
)
