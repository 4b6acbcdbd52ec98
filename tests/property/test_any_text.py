"""Any text gives a tree or diagnostics, never an exception, with spans within the file."""

import random
import re
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obelisk_spec.yaml_core import YamlTextError, core_scalar, load_yaml_core
from obk_cli.compiler import Options, compile_config, compile_source
from obk_cli.config.tree import Tree, TreeList, TreeMap, TreeScalar, plain_value
from obk_cli.config.yaml_parser import decode_source, parse_source
from obk_cli.diagnostics.diagnostic import Diagnostic, worst
from obk_cli.diagnostics.source import SourceFile, Span
from obk_cli.report import report_github, report_json, report_sarif, report_text
from obk_cli.workspace.environment import MachineEnvironment
from obk_cli.workspace.package_index import PackageIndex

CORPUS = Path(__file__).resolve().parents[3] / "shared/corpus"
SEEDS = [path.read_text() for path in sorted(CORPUS.rglob("*.yaml"))]
TESTS = Path(__file__).parents[1]
PLANTED = (TESTS / "planted" / "stack.yaml").read_text()
ALPHABET = "ab:- \n\t[]{},&*!|>'\"#%@`?~0123.<$"
NEARLY_YAML = st.text(ALPHABET) | st.text(st.characters(exclude_categories=["Cs"]))
KEYS = st.sampled_from(
    "config control estimation robot viz joystick pkg executable publishers sim topic params "
    "sensor_settings sensor_names dt msg_type include obk qos on callback_groups remappings".split()
)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(ALPHABET, max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner, max_size=5),
    max_leaves=30,
)
VALID_TEXT = (TESTS / "cases/accept/OBK004/topic_twice.yaml").read_text()
ODD = (
    r'. / .. ~/x //a ./ ~a {x} /dev/zero "a\0b" "a\0b/c" "\e[2J" "\n" "" "${" ${A} "a=b" "-" "*" '
    "0 -1 1e400 .nan -.inf 99999999999999999999 true ~ [] {} [[1]] {a:[~]}"
).split()


@cache
def environment() -> MachineEnvironment:
    """Packages with code and models, so that every check has something to inspect.

    They are the same for all inputs, so that the packages are read once.
    """
    world = MachineEnvironment(Path.cwd(), Path.cwd(), {})
    world.packages = PackageIndex(
        workspaces=(TESTS / "cases" / "workspace",), prefixes=(Path(sys.prefix),)
    )
    return world


def compiled(text: str) -> tuple[Diagnostic, ...]:
    options = Options(variables={}, working_folder=Path.cwd(), environment=environment())
    outcome = compile_source(SourceFile.of("<text>", text), options)
    report_text(outcome.diagnostics, colour=True)
    return outcome.diagnostics


def spans(tree: Tree) -> Iterator[Span]:
    yield tree.span
    match tree:
        case TreeMap():
            for entry in tree:
                yield entry.key_span
                yield from spans(entry.value)
        case TreeList():
            for item in tree.items:
                yield from spans(item)


def assert_inside(span: Span, source: SourceFile) -> None:
    assert 1 <= span.line <= span.end_line <= len(source.lines) + 1
    assert 1 <= span.column <= len(source.line(span.line)) + 1
    assert (span.line, span.column) <= (span.end_line, span.end_column)


@given(st.binary())
def test_any_bytes(data: bytes) -> None:
    source = decode_source("f", data)
    if isinstance(source, SourceFile):
        parse_source(source)


@given(st.binary() | NEARLY_YAML.map(str.encode))
def test_any_file_is_compiled_or_rejected(data: bytes) -> None:
    with tempfile.NamedTemporaryFile(suffix=".yaml") as file:
        file.write(data)
        file.flush()
        outcome = compile_config(
            file.name, Options(variables={}, working_folder=Path(file.name).parent)
        )
    assert outcome.plan is None or worst(outcome.diagnostics) != "error"
    for voice in (report_github, report_sarif):
        voice(outcome.diagnostics)
    report_json([outcome.path], outcome.diagnostics)


@given(NEARLY_YAML)
def test_any_text_is_compiled_or_rejected(text: str) -> None:
    compiled(text)


@given(VALUES.map(repr))
def test_any_shape_of_known_keys_is_compiled_or_rejected(text: str) -> None:
    compiled(text.replace("None", "~"))


@given(st.sampled_from([*SEEDS, PLANTED]), st.integers())
def test_a_mutated_config_is_compiled_or_rejected(text: str, seed: int) -> None:
    draw = random.Random(seed)
    for _ in range(draw.randint(1, 8)):
        at, end = sorted(draw.sample(range(len(text) + 1), 2)) if len(text) > 1 else (0, 0)
        cut = text[at : min(end, at + 30)]
        text = draw.choice(
            [
                text[:at] + text[at + len(cut) :],
                text[:at] + cut + text[at:],
                text[:at] + draw.choice(ALPHABET) + text[at:],
            ]
        )
    compiled(text)


@given(st.sampled_from([PLANTED, VALID_TEXT]), st.sampled_from(ODD), st.integers())
def test_no_value_is_too_odd_anywhere(text: str, odd: str, seed: int) -> None:
    draw = random.Random(seed)
    for _ in range(draw.randint(1, 3)):
        value = draw.choice(list(re.finditer(r"(?<=: )[^][{},#\n]+", text)))
        text = text[: value.start()] + odd + text[value.end() :]
    compiled(text)


@given(NEARLY_YAML)
def test_locations_are_inside_the_text(text: str) -> None:
    source = SourceFile.of("f", text)
    parsed = parse_source(source)
    for diagnostic in parsed.diagnostics:
        assert_inside(diagnostic.span, source)
    if parsed.tree is not None:
        for span in spans(parsed.tree):
            assert_inside(span, source)


@given(NEARLY_YAML)
def test_an_independent_reader_reads_the_same(text: str) -> None:
    parsed = parse_source(SourceFile.of("f", text))
    if parsed.diagnostics or parsed.tree is None or set("\x85\u2028\u2029") & set(text):
        return  # line breaks for the independent reader, as in YAML 1.1
    try:
        value = load_yaml_core(text)
    except YamlTextError:
        return
    if _has_only_text_for_keys(value):
        assert _canonical(plain_value(parsed.tree)) == _canonical(value)


def _canonical(value: object) -> str:
    """Text that is equal for equal values: sorted keys, NaN by name."""
    if isinstance(value, dict):
        return str(sorted((key, _canonical(item)) for key, item in value.items()))
    return str([_canonical(v) for v in value]) if isinstance(value, list) else repr(value)


def _has_only_text_for_keys(value: object) -> bool:
    if isinstance(value, dict):
        return all(isinstance(k, str) and _has_only_text_for_keys(v) for k, v in value.items())
    return not isinstance(value, list) or all(map(_has_only_text_for_keys, value))


@pytest.mark.parametrize("text", SEEDS)
def test_a_plain_value_is_at_its_span(text: str) -> None:
    tree = parse_source(SourceFile.of("f", text)).tree
    assert tree is not None
    for scalar in scalars(tree):
        if scalar.span.text[:1] not in ("'", '"', "|", ">"):
            assert core_scalar(scalar.span.text) == scalar.value


def scalars(tree: Tree) -> Iterator[TreeScalar]:
    match tree:
        case TreeScalar():
            yield tree
        case TreeMap():
            for entry in tree:
                yield from scalars(entry.value)
        case TreeList():
            for item in tree.items:
                yield from scalars(item)
