import os
from collections.abc import Mapping
from pathlib import Path

import pytest

from obk_cli.config.loader import (
    ConfigFiles,
    apply_overrides,
    load_config,
    merge_trees,
    resolve_variables,
)
from obk_cli.config.tree import TreeMap, TreeScalar, plain_value
from obk_cli.config.yaml_parser import parse_source
from obk_cli.diagnostics.source import SourceFile


def tree(text: str, path: str = "f.yaml") -> TreeMap:
    parsed = parse_source(SourceFile.of(path, text))
    assert isinstance(parsed.tree, TreeMap), parsed.diagnostics
    return parsed.tree


@pytest.mark.parametrize(
    ("inner", "outer", "merged"),
    [
        ("{a: 1, b: {c: 1, d: 1}}", "{b: {c: 2}, e: 3}", "{a: 1, b: {c: 2, d: 1}, e: 3}"),
        ("{a: [1, 2]}", "{a: [3]}", "{a: [3]}"),
        ("{a: 1}", "{a: ~}", "{}"),
        ("{a: 1}", "{b: ~}", "{a: 1, b: ~}"),
        ("{l: [{name: x, v: 1}]}", "{l: [{name: x, w: 2}]}", "{l: [{name: x, v: 1, w: 2}]}"),
        ("{l: [{name: x}]}", "{l: [{name: y}]}", "{l: [{name: x}, {name: y}]}"),
        ("{l: [{pkg: x}]}", "{l: [{pkg: x}]}", "{l: [{pkg: x}, {pkg: x}]}"),
        (
            "{l: [{ros_parameter: p_setting, topic: /a}]}",
            "{l: [{key: p, topic: /b}]}",
            "{l: [{ros_parameter: p_setting, topic: /b, key: p}]}",
        ),
        ("{l: [{topic: /a, dt: 1}]}", "{l: [{topic: /a, dt: 2}]}", "{l: [{topic: /a, dt: 2}]}"),
        ("{l: [{name: x, a: 1}]}", "{l: {name: x, a: 2}}", "{l: [{name: x, a: 2}]}"),
        ("{l: [{name: x}, 3]}", "{l: [{name: x}]}", "{l: [{name: x}]}"),
    ],
)
def test_merging(inner: str, outer: str, merged: str) -> None:
    result = merge_trees(tree(inner), tree(outer))
    assert plain_value(result) == plain_value(tree(merged))


def test_merged_values_keep_their_own_file() -> None:
    merged = merge_trees(tree("{a: 1, b: 1}", "inner"), tree("{b: 2}", "outer"))
    assert isinstance(merged, TreeMap)
    assert {entry.key: entry.value.span.path for entry in merged} == {"a": "inner", "b": "outer"}


def include(texts: Mapping[str, str], path: str) -> tuple[object, list[str]]:
    def read(name: str) -> bytes | str:
        return texts[name].encode() if name in texts else "file not found"

    source = SourceFile.of(path, texts[path])
    files = ConfigFiles(source, variables={}, working_folder=Path.cwd(), read=read)
    merged, faults = load_config(source, files, ())
    assert merged is not None
    return plain_value(merged), [str(fault) for fault in faults]


def test_files_are_merged_in_order_with_the_including_one_on_top() -> None:
    files = {
        "d/top.yaml": "include: [a.yaml, ../e/b.yaml]\nx: top\n",
        "d/a.yaml": "{x: a, y: a, z: a}",
        "e/b.yaml": "include: c.yaml\ny: b\n",
        "e/c.yaml": "{y: c, w: c}",
    }
    value, faults = include(files, "d/top.yaml")
    assert value == {"x": "top", "y": "b", "z": "a", "w": "c"}
    assert faults == []


def test_the_same_file_may_be_included_twice_without_a_cycle() -> None:
    files = {"top": "include: [a, b]", "a": "include: [c]", "b": "include: [c]", "c": "x: 1"}
    assert include(files, "top") == ({"x": 1}, [])


def test_a_file_that_two_others_include_contributes_once() -> None:
    files = {
        "top": "include: [a, b]",
        "a": "include: [c]\nx: a\nl: [{name: n, w: a}]",
        "b": "include: [c]\ny: b\nz: ~",
        "c": "{x: c, y: c, z: c, l: [{pkg: p}, {name: n, w: c, m: [{pkg: q}]}]}",
    }
    merged = {"x": "a", "y": "b", "l": [{"pkg": "p"}, {"name": "n", "w": "a", "m": [{"pkg": "q"}]}]}
    assert include(files, "top") == (merged, [])
    files["top"] = "include: [c, a, c]"
    merged["y"] = merged["z"] = "c"
    assert include(files, "top") == (merged, [])


def test_a_file_is_known_by_each_path_to_it() -> None:
    text = "l: [{pkg: p}]"
    folder = Path.cwd().name
    files = {"top": f"include: [c, ../{folder}/c]", "c": text, f"../{folder}/c": text}
    assert include(files, "top") == ({"l": [{"pkg": "p"}]}, [])


def test_a_circle_prints_the_chain() -> None:
    files = {"top": "include: [a]", "a": "include: [b]", "b": "include: [a]\nx: 1"}
    value, faults = include(files, "top")
    assert value == {"x": 1}
    assert faults == ["b:1:11: error[OBK009]: files include each other: a -> b -> a"]


def test_a_circle_is_found_by_any_path_to_the_first_file() -> None:
    again = f"../{Path.cwd().name}/top"
    files = {"top": "include: a\nx: 1", "a": f"include: {again}", again: "x: 1"}
    value, (fault,) = include(files, "top")
    assert value == {"x": 1}
    assert "OBK009" in fault


def test_the_tag_of_a_value_with_variables_counts() -> None:
    text = """
a: !!float ${N}
b: !!str ${N}
c: !!int '${N}'
d: &x !!str ${N}
e: '${N}'
"""
    resolved, faults = resolve_variables(tree(text), {"N": "3"})
    values = plain_value(resolved)
    assert values == {"a": 3.0, "b": "3", "c": 3, "d": "3", "e": "3"}
    assert isinstance(values, dict)
    assert type(values["a"]) is float
    assert faults == ()


def test_variables_are_replaced_and_read_again_unless_quoted() -> None:
    text = """
a: '${N}'
b: "${N}"
c: ${N}
d: x${M:-y}z
e: $${N}
f: $5
g: "${E}${E:-no}"
"""
    resolved, faults = resolve_variables(tree(text), {"N": "3", "E": ""})
    assert plain_value(resolved) == {
        "a": "3",
        "b": "3",
        "c": 3,
        "d": "xyz",
        "e": "${N}",
        "f": "$5",
        "g": "",
    }
    assert faults == ()


def test_an_undefined_variable_is_shown_at_its_location_in_the_text() -> None:
    _, (fault,) = resolve_variables(tree('a: "x/${NONE}/y"'), {})
    assert (fault.span.column, fault.span.text) == (7, "${NONE}")
    _, (malformed,) = resolve_variables(tree('a: "$${X} ${1x}"'), {})
    assert malformed.message == "`${` does not start a `${NAME}`"
    assert malformed.span.column == 11


def override(text: str, *options: str) -> tuple[object, list[str]]:
    result, faults = apply_overrides(tree(text), options)
    return plain_value(result), [fault.message for fault in faults]


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("a[0].b=2", {"a": [{"b": 2}], "m": {"c": 1}}),
        ("m[0].c=x", {"a": [{"b": 1}], "m": {"c": "x"}}),
        ("m.n.o=[1, 2]", {"a": [{"b": 1}], "m": {"c": 1, "n": {"o": [1, 2]}}}),
        ("m=", {"a": [{"b": 1}], "m": None}),
        ("m.c=a=b", {"a": [{"b": 1}], "m": {"c": "a=b"}}),
    ],
)
def test_set(option: str, value: object) -> None:
    assert override("{a: [{b: 1}], m: {c: 1}}", option) == (value, [])


@pytest.mark.parametrize(
    ("option", "reason"),
    [
        ("a", "`=` is missing"),
        ("=1", "the path is empty"),
        ("a..b=1", "is not a path"),
        ("[0]=1", "is not a path"),
        ("a[1].b=1", "out of range"),
        ("a.b=1", "`b` needs a mapping, but its parent is a list"),
        ("m[1]=1", "`[1]` needs a list, found a mapping"),
        ("x[0]=1", "unknown key `x`"),
        ("m.c=[", "never closed"),
        (f"a[{'9' * 5000}].b=1", "is not a path"),
        (f"m{'.a' * 2000}=1", "the path has 2001 steps, expected at most 100"),
    ],
)
def test_an_invalid_set_reports_why(option: str, reason: str) -> None:
    value, faults = override("{a: [{b: 1}], m: {c: 1}}", option)
    assert value == {"a": [{"b": 1}], "m": {"c": 1}}
    assert len(faults) == 1
    assert reason in faults[0]


def test_values_from_set_have_the_command_line_as_location() -> None:
    result, _ = apply_overrides(tree("{a: 1}"), ["a=5"])
    assert result.entries[0].value.span.path == "<command line>"


@pytest.mark.parametrize("value", ["a ${ b", "'${1X}'", "'${'", "'x ${A'"])
def test_an_invalid_reference_is_a_finding_in_the_process_environment(value: str) -> None:
    _, faults = resolve_variables(tree(f"config: {value}"), os.environ)
    assert [fault.message for fault in faults] == ["`${` does not start a `${NAME}`"]


def test_many_references_without_an_end_take_no_longer_than_the_text_is_long() -> None:
    _, faults = resolve_variables(tree(f"a: '{'${A:-' * 60_000}'"), {})
    assert [fault.message for fault in faults] == ["`${` does not start a `${NAME}`"]


def test_an_undefined_variable_is_reported_once_for_a_value() -> None:
    _, faults = resolve_variables(tree("a: ${X} ${X} ${Y}\nb: ${X}"), {})
    assert [(fault.span.line, fault.span.column) for fault in faults] == [(1, 4), (1, 14), (2, 4)]


def test_the_value_of_a_variable_keeps_its_text() -> None:
    resolved, _ = resolve_variables(tree("a: ${N}\nb: ${V:-1.10}\nc: '${N}'\n"), {"N": "012"})
    assert isinstance(resolved, TreeMap)
    values = [entry.value for entry in resolved]
    assert [(v.value, v.text) for v in values if isinstance(v, TreeScalar)] == [
        (12, "012"),
        (1.1, "1.10"),
        ("012", "012"),
    ]


@pytest.mark.parametrize(
    "text",
    [
        f"a: &a '{'x' * 10_000} ${{X}}'\nb: [{'*a, ' * 20_000}]",
        f"a: '{'${LONG}' * 20_000}'",
    ],
)
def test_variables_make_no_text_without_bound(text: str) -> None:
    _, faults = resolve_variables(tree(text), {"X": "x", "LONG": "y" * 100_000})
    assert [fault.message for fault in faults] == [
        "the expanded environment variables exceed 10 MiB in total"
    ]
