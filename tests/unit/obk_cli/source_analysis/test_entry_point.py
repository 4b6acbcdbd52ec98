"""What is known of a node from its source, and what is not reported."""

from collections.abc import Mapping
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obk_cli.config.environment import CodeFault, NodeFacts, SourceFaults
from obk_cli.diagnostics.source import SourceFile
from obk_cli.source_analysis.entry_point import read_node_code
from obk_cli.source_analysis.modules import FoundSource, Module, parse_module

LIBRARY = Path(__file__).parents[4] / "src"
HEAD = """\
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_py.core.control import ObeliskController
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.utils.ros import spin_obelisk
from obelisk_sensor_msgs.msg import ObkImu
"""
TAIL = """
def main():
    spin_obelisk(None, Mine)
"""


def load_from(texts: Mapping[str, str], name: str) -> Module | None:
    """A module from the given sources, or from the runtime library."""
    if name in texts:
        return parse_module(name, FoundSource(source=SourceFile.of(f"{name}.py", texts[name])))
    if not name.startswith("obelisk_py"):
        return None
    path = LIBRARY.joinpath(*name.split("."))
    # A folder without `__init__.py` may be left from another version of the library.
    is_package = (path / "__init__.py").is_file()
    file = path / "__init__.py" if is_package else path.with_suffix(".py")
    if not file.is_file():
        return None
    source = SourceFile.of(file.name, file.read_text(encoding="utf-8"))
    return parse_module(name, FoundSource(source=source, is_package=is_package))


def read(body: str, **modules: str) -> NodeFacts | CodeFault | None:
    texts = {"m": HEAD + body + TAIL, **modules}
    return read_node_code("m", "main", lambda name: load_from(texts, name))


def code(body: str, **modules: str) -> NodeFacts:
    found = read(body, **modules)
    assert isinstance(found, NodeFacts)
    return found


def names(found: NodeFacts) -> list[str]:
    return [component.name for component in found.components]


def node(constructor: str, *, bases: str = "ObeliskNode") -> str:
    lines = "".join(f"        {line}\n" for line in constructor.splitlines())
    return (
        f"class Mine({bases}):\n    def __init__(self, node_name='n', **kwargs):\n"
        f"        super().__init__(node_name, **kwargs)\n{lines}"
        "    def add(self, name):\n        self.register_obk_publisher(name)\n"
        "    def on_x(self, msg):\n        pass\n"
    )


def test_a_local_import_replaces_a_constant_of_the_module() -> None:
    body = node("from package import KEY\nself.register_obk_publisher(KEY, ObkImu)")
    found = code(f"KEY = 'own'\n{body}", package="KEY = 'other'\n")
    assert names(found) == []
    assert not found.knows_components


def test_private_methods_of_a_class_and_its_base_are_different() -> None:
    base = node("self.__set_up()").replace("class Mine", "class Base")
    base += "    def __set_up(self):\n        self.register_obk_timer('base', self.__tick)\n"
    base += "    def __tick(self): ...\n"
    own = node("self.__set_up('own')", bases="Base")
    own += "    def __set_up(self, __name):\n        self.register_obk_timer(__name, self.__tick)\n"
    own += "    def __tick(self, time=0.0): ...\n"
    found = code(base + own)
    assert found.knows_components
    assert names(found) == ["base", "own"]
    assert [c.wrong_callback for c in found.components] == [None, None]
    assert not found.findings


def test_a_method_that_the_class_imports_is_implemented() -> None:
    body = node("pass", bases="ObeliskController") + "    from package import update_x_hat\n"
    found = code(body, package="def update_x_hat(self, msg): ...\n")
    assert [m.name for m in found.missing_methods] == ["compute_control"]


def test_components_of_the_bases_have_the_types_of_the_constructor_call() -> None:
    body = "class Mine(ObeliskController):\n    def __init__(self):\n"
    found = code(body + "        super().__init__('n', est_msg_type=ObkImu)\n")
    assert {c.name: c.msg_type for c in found.components} == {
        "timer_ctrl_setting": None,
        "pub_ctrl_setting": None,
        "sub_est_setting": "obelisk_sensor_msgs/msg/ObkImu",
    }
    assert all(c.is_of_library and c.is_required for c in found.components)
    assert [m.name for m in found.missing_methods] == ["update_x_hat", "compute_control"]


def run_by(main: str) -> NodeFacts | CodeFault | SourceFaults | None:
    body = node("self.register_obk_timer('timer_a', self.on_x)")
    other = "class Other(ObeliskNode):\n    pass\n"
    lines = "".join(f"    {line}\n" for line in main.splitlines())
    text = f"import rclpy\n{HEAD}{body}{other}\ndef main(args=None):\n{lines}"
    return read_node_code("m", "main", lambda name: load_from({"m": text}, name))


def test_a_program_may_run_its_node_itself() -> None:
    found = run_by("rclpy.init(args=args)\nmine = Mine('mine')\nrclpy.spin(mine)")
    assert isinstance(found, NodeFacts)
    assert (found.class_name, names(found)) == ("Mine", ["timer_a"])
    assert not found.is_run_by_library
    spun = run_by("Other()\nspin_obelisk(args, Mine)")
    assert isinstance(spun, NodeFacts)
    assert spun.is_run_by_library


@pytest.mark.parametrize("main", ["pass", "rclpy.spin(args)", "for n in (Mine(), Other()): ..."])
def test_a_program_with_no_or_several_nodes_leaves_the_class_open(main: str) -> None:
    assert run_by(main) is None


def test_a_method_that_the_constructor_calls_registers_too() -> None:
    helper = "    def more(self):\n        self.register_obk_timer('timer_x_setting', self.on_x)\n"
    found = code(node("self.more()") + helper)
    assert names(found) == ["timer_x_setting"]
    assert found.knows_components
    assert found.components[0].is_required


def test_a_method_registers_the_components_named_by_its_calls() -> None:
    found = code(node("self.add('pub_a')\nself.add(name='pub_b')\nself.add('pub_c_setting')"))
    assert names(found) == ["pub_a", "pub_b", "pub_c_setting"]
    assert found.knows_components


def test_a_method_that_calls_itself_ends() -> None:
    circle = "    def circle(self, name):\n        self.register_obk_publisher(name)\n"
    found = code(node("self.circle('a')") + circle + "        self.circle(name)\n")
    assert not found.knows_components


def test_registrations_and_parameters_may_be_of_super() -> None:
    found = code(
        node(
            "super().register_obk_timer('timer_a_setting', self.on_x)\n"
            "super().declare_parameter('kp', 1)"
        )
    )
    assert names(found) == ["timer_a_setting"]
    assert found.components[0].is_required
    assert {"timer_a_setting", "kp"} <= {p.name for p in found.parameters}
    assert found.knows_components
    assert found.knows_parameters


def test_a_registration_method_that_the_class_overrides_is_followed() -> None:
    override = """\
    def register_obk_timer(self, name, key=None):
        return super().register_obk_timer(name, self.on_x, key=key)
"""
    found = code(node("self.register_obk_timer('timer_a_setting')") + override)
    assert names(found) == ["timer_a_setting"]
    assert not found.findings
    assert found.knows_components
    of_any = override.replace("name, key=None", "name, **rest").replace("key=key", "**rest")
    assert not code(node("self.register_obk_timer('timer_a', key='a')") + of_any).knows_components


def test_components_of_the_bases_stay_theirs_if_the_class_overrides_the_method() -> None:
    override = """\
    def register_obk_timer(self, *args, **kwargs):
        return super().register_obk_timer(*args, **kwargs)
"""
    found = code(node("pass", bases="ObeliskController") + override)
    assert all(component.is_of_library for component in found.components)


def test_a_long_sum_of_texts_does_not_end_the_analysis() -> None:
    long = " + ".join(["'a'"] * 400)
    found = code(node(f"text = {long}\nself.register_obk_publisher('pub_a_setting')"))
    assert names(found) == ["pub_a_setting"]


def test_names_may_be_constants_of_the_module_or_of_another() -> None:
    body = "from names import TOPIC as T\nNAME = 'pub_a_setting'\n"
    found = code(
        body + node("self.register_obk_publisher(NAME)\nself.register_obk_publisher(key=T)"),
        names="TOPIC = 'pub_b'\n",
    )
    assert names(found) == ["pub_a_setting", "pub_b"]
    assert found.knows_components


@pytest.mark.parametrize(
    "again",
    [
        "NAME += '_setting'",
        "for NAME in ('pub_b',): ...",
        "with open('x') as NAME: ...",
        "NAME, other = 'pub_b', 1",
        "if (NAME := 'pub_b'): ...",
        "del NAME",
        "while True:\n    NAME = 'pub_b'",
        "try: ...\nexcept OSError as NAME: ...",
        "def rename():\n    global NAME\n    NAME = 'pub_b'",
    ],
)
def test_a_constant_that_is_bound_more_than_once_has_no_known_value(again: str) -> None:
    body = node("self.register_obk_publisher(NAME)")
    assert names(code(f"NAME = 'pub_a'\n{body}")) == ["pub_a"]
    found = code(f"NAME = 'pub_a'\n{again}\n{body}")
    assert names(found) == []
    assert not found.knows_components


def test_a_constant_of_a_module_whose_attribute_is_assigned_has_no_known_value() -> None:
    body = node("self.register_obk_publisher(constants.NAME)")
    modules = {"constants": "NAME = 'pub_a'\nOTHER = 1\n"}
    kept = code(f"import constants\nconstants.OTHER = 'pub_b'\n{body}", **modules)
    assert names(kept) == ["pub_a"]
    changed = code(f"import constants\nconstants.NAME = 'pub_b'\n{body}", **modules)
    assert not changed.knows_components


def test_names_may_be_composed_of_local_names_that_are_assigned_once() -> None:
    lines = "key = NAME + '_a'\nself.register_obk_publisher(f'{key}_setting', key=key)"
    found = code(f"NAME = 'pub'\n{node(lines)}")
    assert [(c.ros_parameter, c.key) for c in found.components] == [("pub_a_setting", "pub_a")]
    assert found.knows_components


@pytest.mark.parametrize(
    "again",
    [
        "key += 'b'",
        "for key in 'ab': ...",
        "del key",
        "def change():\n    nonlocal key\n    key = 'b'",
        "import key",
        "node_name = key = 'b'",
    ],
)
def test_a_local_name_that_is_bound_again_has_no_known_value(again: str) -> None:
    lines = f"key = 'pub_a'\n{again}\nself.register_obk_publisher(key)"
    found = code(node(lines))
    assert names(found) == []
    assert not found.knows_components


def test_a_name_that_doubles_again_and_again_is_not_computed() -> None:
    doubled = "".join(f"n{i + 1} = n{i} + n{i}\n" for i in range(100))
    assert names(code(node(f"n0 = 'a'\n{doubled}self.register_obk_publisher(n100)"))) == []


def test_the_class_may_be_reexported_from_another_module() -> None:
    other = HEAD + node("self.register_obk_publisher('pub_a_setting')")
    package = "from other import Mine\n"
    found = code("from package import Mine\n", package=package, other=other)
    assert names(found) == ["pub_a_setting"]
    assert found.span.path == "other.py"


@pytest.mark.parametrize(
    "constructor",
    [
        "self.register_obk_publisher(f'pub_{self.get_name()}_setting')",
        "self.register_obk_publisher(name)",
        "self.register_obk_publisher(*names)",
        "self.register_obk_publisher(**settings)",
        "self.add(names[0])",
        "register = self.register_obk_publisher",
        "register = super().register_obk_publisher",
        "register_all(self)",
        "other = self",
        "getattr(self, name)('pub_a_setting')",
        "[self.register_obk_publisher(name) for name in names]",
    ],
)
def test_computed_names_leave_the_components_open(constructor: str) -> None:
    assert not code(node(constructor)).knows_components


@pytest.mark.parametrize(
    "body",
    [
        node("pass", bases="ObeliskNode, Unknown"),
        "import elsewhere\n" + node("pass", bases="elsewhere.Mixin, ObeliskNode"),
        "@register\n" + node("pass"),
        "class Mine(ObeliskNode):\n    def __init__(self):\n        start(None)\n",
    ],
)
def test_a_base_or_constructor_that_cannot_be_followed_leaves_everything_open(body: str) -> None:
    found = code(body)
    assert not found.knows_components
    assert not found.knows_parameters
    assert not found.missing_methods


def test_a_method_that_a_branch_of_the_class_defines_is_one() -> None:
    methods = "".join(
        f"        def {name}(self, *_):\n            pass\n"
        for name in ("update_x_hat", "compute_control")
    )
    branches = f"    if sys.platform == 'linux':\n{methods}    else:\n{methods}"
    assert not code(f"class Mine(ObeliskController):\n{branches}").missing_methods


def test_a_mixin_that_two_bases_share_comes_before_the_class_that_it_completes() -> None:
    methods = "    def update_x_hat(self, msg): ...\n    def compute_control(self): ...\n"
    bases = "class First(Mixin, ObeliskController): ...\nclass Second(Mixin): ...\n"
    found = code(f"class Mixin:\n{methods}{bases}class Mine(First, Second): ...\n")
    assert not found.missing_methods


def test_contradictory_bases_do_not_stop_the_analysis() -> None:
    bases = "class First(A, B): ...\nclass Second(B, A): ...\n"
    body = f"class A: ...\nclass B: ...\n{bases}class Mine(First, Second, ObeliskNode): ...\n"
    assert not code(body).components


def test_a_mixin_that_cannot_be_followed_may_implement_the_abstract_methods() -> None:
    assert not code("class Mine(Unknown, ObeliskController):\n    pass\n").missing_methods
    assert code("class Mine(ObeliskController):\n    pass\n").missing_methods


@pytest.mark.parametrize(
    "around", ["if x:", "for x in y:", "while x:", "with_x = lambda: (", "try:"]
)
def test_a_registration_on_a_condition_is_not_required(around: str) -> None:
    call = "self.register_obk_publisher('pub_a_setting')"
    text = f"{around}{call})" if "(" in around else f"{around}\n    {call}"
    if around == "try:":
        text += "\nfinally:\n    pass"
    (component,) = code(node(text)).components
    assert not component.is_required


@pytest.mark.parametrize(
    ("before", "is_required"),
    [
        ("if x:\n    return", False),
        ("with x:\n    if y:\n        return", False),
        ("x and ", False),
        ("if x:\n    raise ValueError", True),
        ("def f():\n    return", True),
        ("f = lambda: None", True),
    ],
)
def test_a_registration_that_a_return_may_skip_is_not_required(
    before: str, is_required: bool
) -> None:
    call = "self.register_obk_publisher('pub_a_setting')"
    text = f"{before}{call}" if before.endswith(" ") else f"{before}\n{call}"
    (component,) = code(node(text)).components
    assert component.is_required is is_required


@pytest.mark.parametrize(
    ("head", "can_damp"),
    [
        ("class Mine(ObeliskRobot):\n", False),
        ("class Mine(ObeliskRobot):\n    def apply_damping(self): ...\n", True),
        ("class Mine(ObeliskMujocoRobot):\n", True),
        ("class Mine(Unknown, ObeliskRobot):\n", None),
        ("class Mine(ObeliskController):\n", None),
    ],
)
def test_whether_a_robot_can_damp_is_known_from_its_methods(
    head: str, can_damp: bool | None
) -> None:
    imports = (
        "from obelisk_py.core.robot import ObeliskRobot\n"
        "from obelisk_py.core.sim.mujoco.robot import ObeliskMujocoRobot\n"
    )
    assert code(f"{imports}{head}    pass\n").can_damp is can_damp


@pytest.mark.parametrize(
    ("arguments", "is_required", "is_optional", "has_default"),
    [
        ("", True, False, False),
        (", required=False", False, True, False),
        (", required=flag", False, False, False),
        (", default='topic:/a'", False, False, True),
        (", default=None", True, False, False),
    ],
)
def test_whether_a_component_may_be_left_out(
    arguments: str, is_required: bool, is_optional: bool, has_default: bool
) -> None:
    (component,) = code(node(f"self.register_obk_publisher('pub_a_setting'{arguments})")).components
    assert component.is_required is is_required
    assert component.is_optional is is_optional
    assert component.has_default is has_default


def test_parameters_may_be_declared_anywhere_in_the_lifecycle() -> None:
    configure = "    def on_configure(self, state):\n        self.declare_parameter('late', 1)\n"
    found = code(
        node("self.declare_parameter('a', 1)\nself.declare_parameters('', [('b', 1), ('c', 2)])")
        + configure
    )
    assert {"a", "b", "c", "late"} <= {declared.name for declared in found.parameters}
    assert found.knows_parameters


@pytest.mark.parametrize(
    "constructor",
    ["self.declare_parameter(name)", "self.declare_parameters('', table)"],
)
def test_computed_parameters_leave_the_parameters_open(constructor: str) -> None:
    found = code(node(constructor))
    assert not found.knows_parameters
    assert found.knows_components


def kinds(found: NodeFacts) -> dict[str, str | None]:
    return {declared.name: declared.kind for declared in found.parameters}


@pytest.mark.parametrize(
    ("default", "kind"),
    [
        ("True", "bool"),
        ("1", "int"),
        ("-1.5", "float"),
        ("'x'", "string"),
        ("[1, -2]", "list of ints"),
        ("(1.0,)", "list of floats"),
        ("[0.0] * JOINTS", "list of floats"),
        ("GAIN", "float"),
        ("shared.GAIN", "int"),
        ("Parameter.Type.STRING_ARRAY", "list of strings"),
        ("1.0, ParameterDescriptor(description='x')", "float"),
        ("value=1.0", "float"),
        ("1.0, ParameterDescriptor(dynamic_typing=True)", None),
        ("1.0, DESCRIPTOR", None),
        ("1.0, ignore_override=True", None),
        ("1.0, **more", None),
        ("[]", None),
        ("[1, 1.0]", None),
        ("None", None),
        ("[JOINTS]", None),
        ("computed()", None),
        ("kp", None),
    ],
)
def test_a_parameter_is_of_the_kind_of_its_default(default: str, kind: str | None) -> None:
    head = "import shared\nfrom rclpy.parameter import Parameter\nJOINTS = 2\nGAIN = 1.0\n"
    constructor = f"kp = 1.0\nself.declare_parameter('a', {default})"
    assert kinds(code(head + node(constructor), shared="GAIN = 3\n"))["a"] == kind


def test_parameters_of_a_list_are_of_the_kinds_of_their_defaults_behind_its_namespace() -> None:
    listed = "[('a', 1.0), ('b', 1), ('c',)]"
    found = kinds(code(node(f"self.declare_parameters('arm', {listed})")))
    assert found.items() >= {"arm.a": "float", "arm.b": "int", "arm.c": None}.items()


def test_a_declaration_in_a_branch_has_an_unknown_kind() -> None:
    found = kinds(code(node("if x:\n    self.declare_parameter('a', 1.0)")))
    assert found["a"] is None


def test_automatically_declared_parameters_leave_the_parameters_open() -> None:
    body = "class Mine(ObeliskNode):\n    def __init__(self):\n"
    declares = "super().__init__('n', automatically_declare_parameters_from_overrides=True)"
    assert not code(f"{body}        {declares}\n").knows_parameters


def test_only_lists_that_are_written_out_into_control_messages_have_a_length() -> None:
    method = """\
    def compute_control(self):
        msg, other = PositionSetpoint(), Unknown()
        plain = PositionSetpoint()
        plain.u_mujoco = [1.0, 2.0]
        plain.u_mujoco = [*values]
        plain.u_mujoco = values
        plain.u_mujoco = []
        other.u = [1.0]
"""
    found = code(node("pass") + method)
    assert [(length.field, length.length) for length in found.control_lengths] == [("u_mujoco", 2)]


@pytest.mark.parametrize(
    "tail",
    [
        "def main():\n    spin_obelisk(None, make())\n",
        "def main():\n    spin_obelisk(None, A if x else B)\n",
        "def main():\n    run()\n",
        "def main():\n    spin_obelisk(None, Mine)\n    spin_obelisk(None, Other)\n",
        "main = make_main(Mine)\n",
        "from elsewhere import main\n",
        "from elsewhere import *\n",
    ],
)
def test_an_entry_point_with_an_unknown_class_reports_nothing(tail: str) -> None:
    text = f"from elsewhere import A, B, Other, make, make_main, run, x\n{HEAD}{node('pass')}{tail}"
    assert read_node_code("m", "main", lambda name: load_from({"m": text}, name)) is None


def test_a_class_that_is_no_obelisk_node_reports_nothing() -> None:
    assert read("class Mine:\n    pass\n") is None


def test_bases_in_a_circle_end() -> None:
    assert read("class Mine(Other):\n    pass\nclass Other(Mine):\n    pass\n") is None


def test_a_fault_in_a_base_is_reported_at_its_location() -> None:
    found = read("from base import Mine\n", base="class Mine(\n")
    assert isinstance(found, CodeFault)
    assert str(found.span) == "base.py:1:11"


SOURCES = [path.read_text(encoding="utf-8") for path in sorted(LIBRARY.rglob("core/*.py"))]


@given(st.sampled_from(SOURCES), st.data())
def test_any_source_is_read_or_reported_as_invalid(text: str, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(text)))
    cut = data.draw(st.integers(0, 30))
    text = text[:at] + data.draw(st.text(max_size=5)) + text[at + cut :]
    for function in ("main", None):
        read_node_code("m", function, lambda name: load_from({"m": text + TAIL}, name))
    read(text)
