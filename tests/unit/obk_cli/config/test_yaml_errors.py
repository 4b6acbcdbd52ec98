"""Common YAML mistakes are reported at their location, with the correct text."""

import pytest
import yaml

from obk_cli.config import yaml_error_context, yaml_parser
from obk_cli.config.yaml_parser import parse_source
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import SourceFile

NODE = """\
config: demo
control:
  - pkg: demo
    publishers:
      - key: pub_ctrl
        topic: /ctrl
        msg_type: Setpoint
    timers:
      - key: timer_ctrl
robot:
  - pkg: demo
"""


def reported(text: str) -> Diagnostic:
    """The only finding in source text."""
    (finding,) = parse_source(SourceFile.of("c.yaml", text)).diagnostics
    return finding


@pytest.fixture(params=["libyaml", "python"], autouse=True)
def parser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both of PyYAML's parsers, whose messages differ; not every PyYAML has the C parser."""
    if request.param == "python":
        for module in (yaml_parser, yaml_error_context):
            monkeypatch.setattr(module, "YAML_LOADER", yaml.SafeLoader)


MISTAKES = [
    # correct text, wrong text, location, message, help
    ("/ctrl", '"/ctrl', "6:16", 'the quote " opened here is never closed', '`"/ctrl"`'),
    ("/ctrl", "'/ctrl  # why", "6:16", "the quote ' opened here is never", "`'/ctrl'`"),
    ("topic: /ctrl", 'qos: {a: "b}', "6:18", "never closed", '`"b"}`'),
    ("/ctrl\n        msg_type: Setpoint", '"/ctrl\n        msg_type: "Setpoint"', "6:16",
     'the quote " opened here is closed only on line 7', '`"/ctrl"`'),
    ("/ctrl", '"/demo"/ctrl', "6:23", '`/ctrl` follows the quote " that', '`"/demo/ctrl"`'),
    ("/ctrl", "'robot's ctrl'", "6:23", "`s ctrl'` follows the quote '", '`"robot\'s ctrl"`'),
    ("/ctrl", '"C:\\demo"', "6:19", "`\\d` is not a YAML escape", "`\\\\`"),
    ("topic: /ctrl\n        msg_type: Setpoint", "qos: [1, 2", "6:14", "the `[` opened here",
     "`[1, 2]`"),
    ("topic: /ctrl\n", "qos: {a: b\n", "6:14", "the `{` opened here is never", "`{a: b}`"),
    ("topic: /ctrl", "qos: {a: b}}", "6:20", "this `}` has no matching", "remove it"),
    ("topic: /ctrl", "qos: {a: [1}", "6:20", "found `}` while the `[` of line 6", "`]` first"),
    ("topic: /ctrl", "qos: {a: b c: d}", "6:20", "a comma is missing before `c`", "with commas"),
    ("topic: /ctrl", "qos: {depth: ${N}}", "6:22", "YAML does not allow `${`", "without braces"),
    ("topic: /ctrl", "topic: [${N}]", "6:17", "YAML does not allow `${`", "without brackets"),
    ("        topic", "       topic", "6:8", "line 5 of the same block", "1 space to the right"),
    ("        topic", "          topic", "6:11", "line 5 of the same", "2 spaces to the left"),
    ("robot:", " robot:", "10:2", "but line 2 of the same block", "1 space to the left"),
    ("    publishers", "publishers", "4:1", "line 3 of the same block", "the same column"),
    ("      - key: timer_ctrl", "      - key: a\n     - key: b", "10:6", "line 9 of the same block",
     "1 space to the right"),
    ("    timers:\n", "    timers:\n      a: b\n", "10:7", "(`-`) appears among the", "a dash"),
    ("topic: /ctrl", "topic:/ctrl", "6:14", "a space is missing after the colon",
     "`topic: /ctrl`"),
    ("- key: pub_ctrl", "-key: pub_ctrl", "5:7", "a space is missing after the dash",
     "`- key: pub_ctrl`"),
    ("publishers:", "publishers", "4:5", "`publishers` has no colon", "`publishers:`"),
    ("topic: /ctrl", "topic /ctrl", "6:9", "`topic` has no colon", "`topic: /ctrl`"),
    ("topic: /ctrl", "topic = /ctrl", "6:9", "`topic` has no colon", "`topic: /ctrl`"),
    ("topic: /ctrl", "topic\uff1a /ctrl", "6:9", "the colon of `topic` is a full-width character",
     "`topic: /ctrl`"),
    ("topic: /ctrl", "topic: demo: ctrl", "6:16", "the value of `topic` contains a colon",
     '`topic: "demo: ctrl"`'),
    ("config: demo", "config: a, b: c", "1:9", "the value of `config` contains a colon",
     "on its own line"),
    ("topic: /ctrl", "topic: - /ctrl", "6:16", "a list item cannot start on the same line",
     "the next line"),
    ("/ctrl", "@ctrl", "6:16", "text cannot start with `@`", '`"@ctrl"`'),
    ("/ctrl", "%ctrl", "6:16", "text cannot start with `%`", '`"%ctrl"`'),
    ("/ctrl", "`ctrl`", "6:16", "text cannot start with", '`"`ctrl`"`'),
    ("/ctrl", "*", "6:16", "text cannot start with `*`", '`"*"`'),
    ("/ctrl", "*ctrl", "6:16", "alias `*ctrl` refers to an undefined", '`"*ctrl"`'),
    ("/ctrl", "& ctrl", "6:16", "text cannot start with `&`", '`"& ctrl"`'),
    ("/ctrl", "|ctrl", "6:16", "text cannot start with `|`", '`"|ctrl"`'),
    ("/ctrl", "{{ robot }}/ctrl", "6:16", "`{{ robot }}/ctrl` is not expanded", "`${NAME}`"),
    ("/ctrl", "{{ robot }}", "6:16", "`{{ robot }}` is not expanded", "`${NAME}`"),
    ("        topic", "\t\ttopic", "6:1", "line 6 is indented with a tab", "spaces"),
    ("        topic", "\u00a0       topic", "6:1", "indented with a no-break space", "spaces"),
    ("    timers:", "<<<<<<< HEAD\n    timers:", "8:1", "merge conflict", "one of the two"),
]  # fmt: skip


@pytest.mark.parametrize(("right", "wrong", "where", "what", "fix"), MISTAKES)
@pytest.mark.parametrize("line_end", ["\n", "\r\n"], ids=["lf", "crlf"])
def test_a_common_mistake_is_reported_at_its_location(
    right: str, wrong: str, where: str, what: str, fix: str, line_end: str
) -> None:
    assert right in NODE
    finding = reported(NODE.replace(right, wrong, 1).replace("\n", line_end))
    assert f"{finding.span.line}:{finding.span.column}" == where
    assert what in finding.message
    assert fix in (finding.help or "")


def test_an_error_far_below_an_open_bracket_is_shown_too() -> None:
    finding = reported(NODE.replace("topic: /ctrl", "qos: [1"))
    assert [(r.message, r.span.line) for r in finding.related] == [("noticed here", 7)]


def test_a_bracket_of_several_lines_lacks_a_comma_not_its_end() -> None:
    finding = reported("a: {\n  b: 1\n  c: 2\n}\n")
    assert finding.message == "a comma is missing before `c`"
    assert finding.span.line == 3


def test_an_uncommon_mistake_is_reported_with_the_parsers_message() -> None:
    finding = reported("%YAML 9.1\n---\na: 1\n")
    assert finding.message.startswith("not valid YAML: ")


def test_mistakes_are_not_searched_in_generated_lines() -> None:
    finding = reported("a: '" + " " * 100_000)
    assert finding.message.startswith("not valid YAML: ")
