"""OBK4xx: packages, executables, files. Data only."""

from obk_cli.diagnostics.rules.rule import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    Rule(
        code="OBK401",
        severity="error",
        title="a package was not found",
        cause="It is not in the workspace, the Python environment or AMENT_PREFIX_PATH.",
        fix="Correct the name, add the package to the workspace, or source the workspace that "
        "contains it.",
    ),
    Rule(
        code="OBK402",
        severity="error",
        title="the package has no such executable",
        cause="The package exists, but it has no such executable, or the executable cannot run. "
        "It may be declared in CMakeLists.txt but not built, or built in a workspace that has not "
        "been sourced, or it may lack the execute bit.",
        fix="Correct the name, or add the entry point to the package. The finding's help line "
        "shows the command that builds the package, sources its workspace or sets the "
        "execute bit.",
    ),
    Rule(
        code="OBK403",
        severity="error",
        title="the package of a model or description was not found",
        cause="`robot_pkg` is looked up in the workspace, the Python environment and "
        "AMENT_PREFIX_PATH.",
        fix="Correct the name, or add the package to the workspace.",
    ),
    Rule(
        code="OBK404",
        severity="warning",
        title="a file that the config names is missing",
        cause="The path is passed to a node, which may not start without the file.",
        fix="Correct the path.",
    ),
    Rule(
        code="OBK405",
        severity="error",
        title="a component is missing from the config",
        cause="The node's class registers the component, and the node cannot be configured "
        "without its settings. The finding is a warning if the node only logs the missing "
        "component, as with the Python API of May 2026, and info-level if the component is "
        "optional.",
        fix="Add the component to the config, or register it with `required=False`.",
    ),
    Rule(
        code="OBK406",
        severity="error",
        title="a component that the code does not register",
        cause="The node's class has no component of this name, so the entry would have no "
        "effect. The finding is info-level if the component is for the hardware and the simulator "
        "ignores it.",
        fix="Write the name that the code registers, or remove the entry.",
    ),
    Rule(
        code="OBK407",
        severity="error",
        title="`msg_type` differs between config and code",
        cause="The node's class registers the component with another message class.",
        fix="Write the type from the code, leave `msg_type` out, or change the type in the code.",
    ),
    Rule(
        code="OBK408",
        severity="error",
        title="an abstract method that is not implemented",
        cause="Python cannot instantiate a class that does not implement every abstract method.",
        fix="Implement the method.",
    ),
    Rule(
        code="OBK409",
        severity="warning",
        title="a parameter that the code does not declare",
        cause="A ROS node receives only the parameters that it declares, so this one has no "
        "effect. The finding is info-level if no declared parameter has a similar name. If the "
        "code "
        "computes parameter names, only likely misspellings of declared but unset parameters are "
        "reported.",
        fix="Correct the name, or declare the parameter with `Parameter` in the node's class.",
    ),
    Rule(
        code="OBK410",
        severity="error",
        title="the node's source cannot be run",
        cause="The file is not valid Python, or does not define the function that the entry point "
        "refers to.",
        fix="Fix the source at the reported location, or the entry point in `setup.py`.",
    ),
    Rule(
        code="OBK411",
        severity="error",
        title="the package of a message type was not found",
        cause="It is not in the workspace, the Python environment or AMENT_PREFIX_PATH.",
        fix="Correct the name, put the message package into the workspace, or source the "
        "workspace that contains it.",
    ),
    Rule(
        code="OBK412",
        severity="error",
        title="a parameter of the wrong type",
        cause="A ROS parameter must have the type of its default. A node that declares a float "
        "does not start if it gets an int, such as `2` instead of `2.0`. Only a float "
        "declared with `Parameter` accepts an int.",
        fix="Write a value of the declared type, or declare the parameter with `Parameter` or "
        "with `ParameterDescriptor(dynamic_typing=True)`.",
    ),
    Rule(
        code="OBK413",
        severity="warning",
        title="a message package that shadows one of Obelisk's",
        cause="A package in the workspace has the name of one of Obelisk's message packages but "
        "comes from another release. All nodes use it, and it lacks messages or fields. If the "
        "stack uses none of them, the finding is info-level.",
        fix="Add the missing messages or fields, or remove the package from the workspace.",
    ),
    Rule(
        code="OBK414",
        severity="error",
        title="a malformed package.xml",
        cause="The file is not well-formed XML, or it has no `<name>`. colcon does not build "
        "such a package, and other tools do not find it.",
        fix="Fix package.xml at the reported location.",
    ),
    Rule(
        code="OBK415",
        severity="error",
        title="a parameter value that its declaration does not allow",
        cause="The node's class declares limits or an enum for this `Parameter`, or its default "
        "is a tuple, which sets the number of items. The node fails to start if the config sets a "
        "value that the declaration does not allow. The same applies to the simulator's "
        "`realtime_factor` and `clock_rate`.",
        fix="Write an allowed value, or change the declaration in the code.",
    ),
    Rule(
        code="OBK420",
        severity="error",
        title="an undefined name",
        cause="A class was renamed, or an import is missing. Python raises a `NameError` when it "
        "reaches the name. In a method, the finding is a warning. Names in a `try` with handlers "
        "and modules that use `import *` or `exec` are not checked.",
        fix="Correct the name, or import it.",
    ),
    Rule(
        code="OBK421",
        severity="error",
        title="an import that fails",
        cause="The package is not installed in `obk`'s Python environment, the module does "
        "not exist, or it does not define the name. Only imports that always run when the "
        "node starts are checked, not those inside `try` or `if` blocks or in functions that may "
        "not run at startup. If ROS 2 is not installed, imports of its packages and of message "
        "packages are not checked, which one info-level finding reports.",
        fix="Correct the name, or install the package. If the node can run without it, wrap "
        "the import in `try: ... except ImportError: ...`.",
    ),
    Rule(
        code="OBK422",
        severity="error",
        title="a missing call to the base class",
        cause="The base class constructor creates the ROS node and registers its components, and "
        "the base class `on_configure` creates their publishers, subscriptions and timers. Other "
        "overrides of lifecycle callbacks need not call the base class.",
        fix="Start the constructor with `super().__init__(node_name)`. Call "
        "`super().on_configure(state)` in `on_configure`.",
    ),
    Rule(
        code="OBK423",
        severity="error",
        title="an unknown component key",
        cause="`obk_publishers`, `obk_subscriptions` and `obk_timers` contain the registered "
        "components. Any other key raises a `KeyError`.",
        fix="Use the key of a registered component, or register one with this key.",
    ),
    Rule(
        code="OBK424",
        severity="error",
        title="an undefined callback",
        cause="Python raises an `AttributeError` when the component is registered.",
        fix="Correct the name, or define the method.",
    ),
    Rule(
        code="OBK425",
        severity="error",
        title="a component without a message type",
        cause="Neither the config nor the node's class defines the type, so the node cannot be "
        "configured.",
        fix="Add `msg_type` to the component, or pass the message class when registering it.",
    ),
    Rule(
        code="OBK426",
        severity="warning",
        title="a callback that waits for its own executor",
        cause="One thread runs all callbacks of a node. `client.call(...)` in a callback waits "
        "for a response that the same thread would have to receive, so the node hangs. "
        "`rclpy.spin_until_future_complete(self, ...)` removes the node from its executor, "
        "which then stops running its callbacks.",
        fix="Use `await client.call_async(...)` in an `async def` callback, or continue in a "
        "done callback: `client.call_async(...).add_done_callback(...)`.",
    ),
    Rule(
        code="OBK427",
        severity="error",
        title="an invalid registration",
        cause="The arguments of `register_obk_...` fit none of its signatures, or the component "
        "is already registered. The node cannot be created or configured.",
        fix="Pass the name, then the callback of a subscription or timer, and the message class. "
        "Register each component once.",
    ),
    Rule(
        code="OBK428",
        severity="error",
        title="a callback with the wrong arguments",
        cause="A timer calls its callback without arguments, and a subscription passes the "
        "message. If the callback does not accept that, a subscription cannot be configured, and "
        "a timer raises a `TypeError` when it first fires. Only lambdas and undecorated methods "
        "are checked.",
        fix="Declare the callback of a timer as `def name(self)`, and that of a subscription as "
        "`def name(self, msg)`.",
    ),
    Rule(
        code="OBK429",
        severity="warning",
        title="an assignment to a parameter",
        cause="`self.gain = 2.0` changes only the attribute of a `Parameter`. `obk param get`, "
        "recordings and `obk param save` keep the value of the ROS parameter, and the next "
        "`obk param set` replaces the assigned one.",
        fix="Store the value under another name. To change the parameter itself, call "
        "`self.set_parameters`.",
    ),
)
