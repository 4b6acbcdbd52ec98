"""Certain errors in a node's source, and possibly valid code, which has no findings."""

import pytest

from obk_cli.config.environment import CodeFault, NodeFacts, SourceFaults
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.source_analysis.entry_point import read_node_code
from obk_cli.source_analysis.imports import ImportPlaces

from .test_entry_point import HEAD, TAIL, code, load_from, names, node, read

INSTALLED = (
    "numpy",
    "sensor_msgs",
    "obelisk_control_msgs",
    "obelisk_sensor_msgs",
    "sys",
    "typing",
    "contextlib",
)


def codes(body: str, **modules: str) -> list[str]:
    """The findings of a source, including its imports."""
    return [finding.code for finding in findings(body, **modules)]


def findings(
    body: str, *, missing_ros: str | None = None, **modules: str
) -> tuple[Diagnostic, ...]:
    texts = {"m": HEAD + body + TAIL, **modules}
    places = ImportPlaces(
        may_exist=lambda name: (
            name.partition(".")[0] in INSTALLED or load_from(texts, name) is not None
        ),
        siblings=lambda _: tuple(texts),
        is_read=lambda _: True,
        is_own=lambda name: name in texts,
        message_names=lambda name: ("Imu", "Joy") if name == "sensor_msgs.msg" else None,
        missing_ros=lambda: missing_ros,
    )
    found = read_node_code("m", "main", lambda name: load_from(texts, name), places)
    assert isinstance(found, NodeFacts | SourceFaults | CodeFault | None)
    return found.findings if isinstance(found, NodeFacts | SourceFaults) else ()


OWN = "class Mine(ObeliskNode):\n    pass\n"


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("import nowhere\n" + OWN, ["OBK421"]),
        ("import nowhere\nfrom nowhere import x\n" + OWN, ["OBK421"]),
        ("import nowhere, elsewhere\n" + OWN, ["OBK421", "OBK421"]),
        ("from package import Gone\n" + OWN, ["OBK421"]),
        ("from package import kept, Gone\n" + OWN, ["OBK421"]),
        ("import package.gone\n" + OWN, ["OBK421"]),
        ("from sensor_msgs.msg import Imu, Yoj, _joy\n" + OWN, ["OBK421"]),
        ("class Mine(ObelskNode):\n    pass\n", ["OBK420"]),
        ("x = undefined\n" + OWN, ["OBK420"]),
        ("@undefined\ndef f(): ...\n" + OWN, ["OBK420"]),
        (OWN + "    def f(self):\n        return undefined\n", ["OBK420"]),
        ("x = undefined\n" + OWN + "    def f(self):\n        return undefined\n", ["OBK420"]),
    ],
)
def test_certain_failures_are_found_once(body: str, expected: list[str]) -> None:
    assert codes(body, package="kept = 1\n") == expected


TUNED = (
    "from obelisk_py.core.parameter import Parameter\n"
    "class Mine(ObeliskNode):\n    kp = Parameter(1.0)\n    def f(self, other):\n        "
)


@pytest.mark.parametrize(
    ("statement", "count"),
    [
        ("self.kp = 2.0", 1),
        ("self.kp += 2.0", 1),
        ("self.kp: float = 2.0", 1),
        ("self.ki, self.kp = 2.0, self.kp", 1),
        ("self.ki = self.kp", 0),
        ("other.kp = 2.0", 0),
        ("self.kp.x = self.x[self.kp] = 2.0", 0),
        ("class Own:\n            def g(self):\n                self.kp = 2.0", 0),
    ],
)
def test_an_assignment_to_a_parameter_is_found(statement: str, count: int) -> None:
    assert codes(TUNED + statement + "\n") == ["OBK429"] * count


def test_without_ros_one_info_replaces_the_errors_of_its_imports() -> None:
    body = (
        "import rclpy\nimport std_msgs.msg\nfrom lidar_msgs.msg import Turn\nimport tf2_ros\n"
        "from lidar.srv import Start\nimport nowhere\n" + OWN
    )
    found = findings(body, missing_ros="install it")
    assert [(finding.code, finding.severity) for finding in found] == [
        ("OBK421", "info"),
        ("OBK421", "error"),
    ]
    assert found[0].help == "install it"
    assert [finding.severity for finding in findings(body)] == ["error"] * 6


@pytest.mark.parametrize(
    "text",
    [
        "try:\n    import nowhere\nexcept ImportError:\n    nowhere = None\n",
        "try:\n    import nowhere\nexcept Exception:\n    pass\n",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import nowhere\n",
        "import sys\nif sys.platform == 'win32':\n    import nowhere\n",
        "from contextlib import suppress\nwith suppress(ImportError):\n    import nowhere\n",
        "def f():\n    import nowhere\n",
        "import sys\nsys.path.append('/x')\nimport nowhere\n",
        "from package import kept\n",
        "from package import *\nx = anything\n",
        "from package import __version__\n",
        "from opaque import anything\n",
        "from starred import anything\n",
        "from lazy import anything\n",
        "from partly import either, looped, walrus, handled\n",
        "x: undefined = 1\n",
        "def f(x: undefined) -> undefined: ...\n",
        "try:\n    x = undefined\nexcept NameError:\n    x = None\n",
        "import sys\nx = unicode if sys.version_info < (3,) else str\n",
        "exec('undefined = 1')\nx = undefined\n",
        "globals()['undefined'] = 1\nx = undefined\n",
        "x = [n for n in range(3) if (m := n)]\ny = m\n",
        "def f():\n    global late\n    late = 1\ndef g():\n    return late\n",
        "match 1:\n    case [*rest]:\n        x = rest\n",
        "match 1:\n    case {'a': 1, **more}:\n        x = more\n",
        "print(__file__, __name__, _)\n",
        "def f():\n    return locals_of_another\nlocals_of_another = 1\n",
    ],
)
def test_possibly_valid_code_has_no_findings(text: str) -> None:
    modules = {
        "package": "kept = 1\n",
        "opaque": "exec('anything = 1')\n",
        "starred": "from elsewhere import *\n",
        "lazy": "def __getattr__(name): ...\n",
        "partly": "if 1:\n    either = 1\nfor looped in (): ...\nprint(walrus := 1)\n"
        "try: ...\nexcept E as handled: ...\n",
    }
    assert not codes(text + OWN, elsewhere="", **modules)


@pytest.mark.parametrize(
    "constructor",
    [
        "        pass\n",
        "        self.gain = 1.0\n        self.prepare()\n",
    ],
)
def test_a_constructor_that_leaves_the_base_out_is_found(constructor: str) -> None:
    rest = "    def prepare(self): ...\n"
    assert codes(f"class Mine(ObeliskNode):\n    def __init__(self):\n{constructor}{rest}") == [
        "OBK422"
    ]


@pytest.mark.parametrize(
    "constructor",
    [
        "super().__init__('n')",
        "super(Mine, self).__init__('n')",
        "ObeliskNode.__init__(self, 'n')",
        "self.prepare()",
        "prepare(self)",
        "init = super().__init__\n        init('n')",
        "for base in Mine.__bases__: base.__init__(self, 'n')",
    ],
)
def test_a_constructor_that_may_run_the_base_is_not_found(constructor: str) -> None:
    helper = "    def prepare(self):\n        super().__init__('n')\n"
    body = f"class Mine(ObeliskNode):\n    def __init__(self):\n        {constructor}\n{helper}"
    assert "OBK422" not in codes(f"from package import prepare\n{body}", package="prepare = 1\n")


@pytest.mark.parametrize(
    ("body", "is_found"),
    [
        ("return 1", True),
        ("self.x = self.get_name()\n        return 1", True),
        ("raise ValueError", True),
        ("return super().on_configure(state)", False),
        ("return super(Mine, self).on_configure(state)", False),
        ("return Base.on_configure(self, state)", False),
        ("return self.first(state)", False),
        ("return getattr(super(), 'on_' + 'configure')(state)", False),
        ("return configure(self)", False),
        ("for base in Mine.__mro__: base.on_configure(self, state)", False),
    ],
)
def test_an_on_configure_that_leaves_the_base_out_is_found(body: str, is_found: bool) -> None:
    text = (
        "from package import Unknown, configure, made\nclass Base(ObeliskNode):\n    pass\n"
        f"class Mine(Base):\n    def on_configure(self, state):\n        {body}\n"
        "    def on_shutdown(self, state):\n        return 1\n"
    )
    through = (
        "    def first(self, state):\n        return self.second(state)\n"
        "    def second(self, state):\n        return super().on_configure(state)\n"
    )
    helpers = through if "self.first" in body else ""
    package = "Unknown = configure = made = 1\n"
    assert codes(text + helpers, package=package) == (["OBK422"] if is_found else [])
    for possible in (
        text.replace("(Base)", "(Unknown, Base)"),
        text.replace("    def on_configure", "    @made\n    def on_configure"),
        f"{text}    on_configure = made(on_configure)\n",
        f"{text}{through}",
        "def run(node, state): return ObeliskNode.on_configure(node, state)\n" + text,
        "RUN = (configure, 'on_configure')\n" + text,
        text.replace("(Base)", "(Base, metaclass=made)"),
    ):
        assert codes(possible, package=package) == []


@pytest.mark.parametrize(
    ("call", "is_found"),
    [
        ("subscription('sub_a', self.on_x, 'String', key='a', msg_type=ObkImu, kind=1)", True),
        ("subscription('sub_a_setting', self.on_x, msg_type='ObkImu')", True),
        ("subscription('sub_a_setting', msg_type=ObkImu)", True),
        ("timer('timer_a', self.on_x, period=0.1)", True),
        ("timer('timer_a')", True),
        ("publisher('pub_a', ObkImu, default='topic:/a', topic='/a')", True),
        ("publisher('pub_a_setting', 'a', ObkImu)", False),
        ("publisher('pub_a', msg_type=self.kind)", False),
        ("timer('timer_a', callback=self.on_x)", False),
        ("timer(*self.given)", False),
    ],
)
def test_an_invalid_registration_is_reported_if_it_certainly_runs(
    call: str, is_found: bool
) -> None:
    body = node(f"self.register_obk_{call}") + "    def on_x(self, msg=None): ...\n"
    assert codes(body) == (["OBK427"] if is_found else [])
    unsure = body.replace("self.register_obk", "if node_name: self.register_obk")
    assert codes(unsure) == []


@pytest.mark.parametrize(
    ("second", "is_found"),
    [
        ("'timer_a_setting', self.on_x, 'a'", True),
        ("'timer_a', self.on_x, required=False", True),
        ("'timer_b', self.on_x", False),
    ],
)
def test_a_component_is_registered_once(second: str, is_found: bool) -> None:
    first = "self.register_obk_timer('timer_a', self.on_x)"
    body = "    def on_x(self): ...\n"
    twice = node(f"{first}\nself.register_obk_timer({second})") + body
    assert codes(twice) == (["OBK427"] if is_found else [])
    inner = f"if node_name: {first}\nelse: self.register_obk_timer({second})"
    assert codes(node(inner) + body) == []


@pytest.mark.parametrize(
    ("more", "is_found"),
    [
        ("", True),
        ("    def tick(self): ...\n", False),
        ("    tick = None\n", False),
        ("    def set(self):\n        self.tick = print\n", False),
        ("    def set(self):\n        setattr(self, 'tick', print)\n", False),
        ("    def __getattr__(self, name): ...\n", False),
        ("    def set(self):\n        self.__dict__['tick'] = print\n", False),
        ("Mine.tick = print\n", False),
    ],
)
def test_a_callback_is_missing_only_if_nothing_can_set_it(more: str, is_found: bool) -> None:
    body = node("self.register_obk_timer('timer_a', self.tick)") + more
    assert codes(body) == (["OBK424"] if is_found else [])
    assert not codes(
        body.replace("(ObeliskNode)", "(Unknown, ObeliskNode)").replace(
            "class Mine", "from package import Unknown\nclass Mine"
        ),
        package="Unknown = make()\nfrom elsewhere import make\n",
        elsewhere="make = 1\n",
    )


TIMER = "self.register_obk_timer('timer_a', self.call)"
SUBSCRIPTION = "self.register_obk_subscription('sub_a', self.call, ObkImu)"


@pytest.mark.parametrize(
    ("call", "method", "is_found"),
    [
        (TIMER, "def call(self, event): ...", True),
        (TIMER, "def call(): ...", True),
        (TIMER, "async def call(self, *, event): ...", True),
        (TIMER, "def call(self, event=None, *, name='x'): ...", False),
        (TIMER, "def call(self, *events, **more): ...", False),
        (TIMER, "@bound\n    def call(self, event): ...", False),
        (TIMER, "def call(self, event): ...\n    call = bound(call)", False),
        (TIMER, "def call(self, event): ...\n    def set(self): self.call = bound", False),
        (TIMER, "def call(self, event): ...\n    def set(self): vars(self)['call'] = bound", False),
        (TIMER, "if x: ...\n    else:\n        def call(self, event): ...", False),
        (SUBSCRIPTION, "def call(self): ...", True),
        (SUBSCRIPTION, "def call(self, *, msg): ...", True),
        (SUBSCRIPTION, "def call(self, msg, info, time): ...", True),
        (SUBSCRIPTION, "def call(self, msg): ...", False),
        (SUBSCRIPTION, "def call(self, msg, info): ...", False),
        (SUBSCRIPTION, "def call(self, *messages): ...", False),
        ("self.register_obk_timer('timer_a', lambda event: 1)", "", True),
        ("self.register_obk_timer('timer_a', lambda event=1: 1)", "", False),
        ("self.register_obk_subscription('sub_a', lambda: 1, ObkImu)", "", True),
        ("self.register_obk_subscription('sub_a', lambda msg, n=1: 1, ObkImu)", "", False),
        (
            "self.register_obk_timer('timer_a', partial(self.call, 1))",
            "def call(self, x): ...",
            False,
        ),
        ("self.register_obk_timer('timer_a', self.other.call)", "def call(self, x): ...", False),
        ("for each in (self.call,): self.register_obk_timer('timer_a', each)", "", False),
        ("self.register_obk_timer('timer_a', self.get_clock)", "", False),
    ],
)
def test_a_callback_must_accept_what_its_component_passes(
    call: str, method: str, is_found: bool
) -> None:
    (component,) = code(node(call) + f"    {method}\n").components
    finding = component.wrong_callback
    assert (finding.code if finding else None) == ("OBK428" if is_found else None)


@pytest.mark.parametrize(
    ("call", "creator"), [(TIMER, "create_timer"), (SUBSCRIPTION, "create_subscription")]
)
def test_a_callback_that_an_own_method_may_wrap_is_not_checked(call: str, creator: str) -> None:
    wrong = "    def call(self, *, event): ...\n"
    for method, expected in ((creator, None), ("create_client", "OBK428")):
        body = node(call) + wrong + f"    def {method}(self, *args, **kwargs): ...\n"
        (component,) = code(body).components
        finding = component.wrong_callback
        assert (finding.code if finding else None) == expected


def test_a_callback_of_an_unknown_or_replaced_base_is_not_checked() -> None:
    wrong = "    def call(self, event): ...\n"
    texts = {"package": "from elsewhere import Unknown\n", "elsewhere": "Unknown = make()\n"}
    replaced = f"class Base(ObeliskNode):\n{wrong}{node(TIMER, bases='Base')}    call = bound\n"
    unknown = f"from package import Unknown\n{node(TIMER, bases='Unknown, ObeliskNode')}{wrong}"
    for body in (replaced, unknown):
        assert [c.wrong_callback for c in code(body, **texts).components] == [None]


@pytest.mark.parametrize(
    ("lookup", "keys"),
    [
        ("self.obk_publishers['a'].publish(1)", ["a"]),
        ("self.obk_timers[KEY].cancel()", ["key of the module"]),
        ("self.obk_publishers[f'{self.t}']", []),
        ("self.obk_publishers[msg]", []),
        ("for key in 'ab': self.obk_publishers[key]", []),
        ("self.obk_publishers.get('a')", []),
        ("if 'a' in self.obk_publishers: self.obk_publishers['a']", []),
        ("other.obk_publishers['a']", []),
        ("with suppress(KeyError): self.obk_publishers['a']", []),
        ("try: self.obk_publishers['a']\n        except KeyError: pass", []),
    ],
)
def test_only_keys_that_are_certainly_used_count(lookup: str, keys: list[str]) -> None:
    body = f"KEY = 'key of the module'\n{node('pass')}    def use(self, msg):\n        {lookup}\n"
    assert [use.key for use in code(body).key_uses] == keys


@pytest.mark.parametrize(
    "other_use",
    [
        "self.obk_publishers['a'] = self.create_publisher(ObkImu, 'a', 1)",
        "self.obk_publishers.update(a=1)",
        "fill(self.obk_publishers)",
        "self.obk_publishers = {'a': 1}",
        "return 'a' in self.obk_publishers",
    ],
)
def test_keys_of_a_table_that_the_class_may_extend_are_not_checked(other_use: str) -> None:
    base = "class Base(ObeliskNode):\n    def set_up(self):\n        " + other_use + "\n"
    own = node("pass", bases="Base") + "    def set_up(self):\n        super().set_up()\n"
    use = "    def use(self):\n        self.obk_publishers['a']\n        self.obk_timers['t']\n"
    assert [use.key for use in code(base + own + use).key_uses] == ["t"]


@pytest.mark.parametrize(
    ("value", "length"),
    [
        ("[0.0] * JOINTS", 12),
        ("JOINTS * [0.0, 1.0]", 24),
        ("[0.0] * (LEGS * 3 - 1)", 11),
        ("[0.0] * self.N", 3),
        ("[0.0] * shared.N", 7),
        ("[0.0, *rest]", None),
        ("[0.0] * JOINTS + [1.0]", 13),
        ("[0.0 for _ in range(LEGS)]", 4),
        ("[0.0 for x in range(LEGS) if x]", None),
        ("np.zeros(JOINTS).tolist()", 12),
        ("np.zeros((3, 4)).ravel()", None),
        ("[0.0] * len(self.q)", None),
        ("[0.0] * count", None),
        ("[0.0] * self.M", None),
        ("[0.0] * self.FLAG", None),
        ("[0.0] * CHANGED", None),
        ("[0.0] * 99999999999999", None),
        ("[0.0] * True", None),
        ("[0.0] * -1", None),
    ],
)
def test_the_length_of_a_list_follows_from_constants(value: str, length: int | None) -> None:
    head = (
        "import numpy as np\nimport shared\nLEGS = 4\nJOINTS = 12\nCHANGED = 1\n"
        "if LEGS:\n    CHANGED = 2\n"
    )
    method = (
        "    N = 3\n    M = 3\n    FLAG = True\n    def f(self, count):\n        self.M = 4\n"
        f"        msg = PositionSetpoint()\n        msg.u_mujoco = {value}\n"
    )
    found = code(head + node("pass") + method, shared="N = 7\n").control_lengths
    assert [one.length for one in found] == ([] if length is None else [length])


def test_an_expression_of_thousands_of_terms_gives_no_result() -> None:
    method = "    def f(self):\n        msg = PositionSetpoint()\n        msg.u_mujoco = [0.0] * "
    read(node("pass") + method + "(" + "1 + " * 900 + "1)\n")
    read(node("pass") + method + "-" * 90 + "1\n")


@pytest.mark.parametrize(
    ("call", "name", "has_type", "is_required"),
    [
        ("register_obk_publisher('a_setting', key='a', msg_type=ObkImu)", "a_setting", True, True),
        ("register_obk_publisher('a_setting', 'a', ObkImu)", "a_setting", True, True),
        ("register_obk_publisher('a_setting', ObkImu, 'a')", "a_setting", True, True),
        ("register_obk_publisher('a_setting', ObkImu, None)", "a_setting", True, True),
        ("register_obk_publisher('a', ObkImu)", "a", True, False),
        ("register_obk_publisher(key='a', msg_type=ObkImu)", "a", True, False),
        ("register_obk_subscription('a', self.on_x, ObkImu)", "a", True, False),
        ("register_obk_subscription('a_setting', self.on_x, ObkImu, 'a')", "a_setting", True, True),
        ("register_obk_subscription('a_setting', self.on_x, 'a')", "a_setting", False, True),
        ("register_obk_timer('a', self.on_x)", "a", False, False),
        ("register_obk_timer('a_setting', self.on_x, 'a')", "a_setting", False, True),
    ],
)
def test_every_generation_of_the_api_is_read(
    call: str, name: str, has_type: bool, is_required: bool
) -> None:
    found = code(node(f"self.{call}"))
    assert found.knows_components
    assert names(found) == [name]
    assert "a" in found.components[0].names
    assert found.components[0].has_type is has_type
    assert found.components[0].is_required is is_required
    assert not found.findings
