from pathlib import Path

import pytest

from obk_cli.config.tree import TreeList, TreeMap, TreeScalar, kind_of, plain_value
from obk_cli.config.yaml_parser import decode_source, parse_source
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import LONGEST_FILE_BYTES, SourceFile


def parse(text: str) -> TreeMap:
    parsed = parse_source(SourceFile.of("f.yaml", text))
    assert parsed.diagnostics == ()
    assert isinstance(parsed.tree, TreeMap)
    return parsed.tree


def codes(text: str) -> list[str]:
    return [fault.code for fault in parse_source(SourceFile.of("f.yaml", text)).diagnostics]


def test_every_value_has_its_location() -> None:
    tree = parse("a: 'x'\nb:\n  - on\n  - 1e-3\nc: {d: ~}\n")
    a, b, c = tree.entries
    assert (a.key_span.line, a.key_span.column, a.key_span.text) == (1, 1, "a")
    assert a.value.span.text == "'x'"
    assert isinstance(b.value, TreeList)
    assert [str(item.span) for item in b.value.items] == ["f.yaml:3:5", "f.yaml:4:5"]
    assert isinstance(c.value, TreeMap)
    null = c.value.entries[0].value
    assert isinstance(null, TreeScalar)
    assert (null.value, null.span.text, null.span.column) == (None, "~", 8)


def test_scalars_are_those_of_yaml_1_2() -> None:
    tree = parse("{on: off, a: 012, b: 0o17, c: '1', d: 1e-3, e: None, f: !!str 5}")
    assert plain_value(tree) == {
        "on": "off",
        "a": 12,
        "b": 15,
        "c": "1",
        "d": 0.001,
        "e": "None",
        "f": "5",
    }


def test_a_tag_sets_the_type_of_its_scalar() -> None:
    tree = parse("{a: !!int '10', b: !!float 2, c: !!bool \"true\", d: !!null '', e: !!float 0x10}")
    values = [entry.value.value for entry in tree if isinstance(entry.value, TreeScalar)]
    assert values == [10, 2.0, True, None, 16.0]
    assert [type(value) for value in values] == [int, float, bool, type(None), float]


@pytest.mark.parametrize("value", ["!!int a", "!!int 1.5", "!!bool 1", "!!null x", "!!float a"])
def test_a_tag_that_does_not_fit_its_scalar_is_found(value: str) -> None:
    assert codes(f"a: {value}\n") == ["OBK005"]


@pytest.mark.parametrize("char", ["\x85", "\u2028", "\u2029"])
def test_only_the_line_breaks_of_yaml_1_2_are_line_breaks(char: str) -> None:
    tree = parse(f"# a {char} b\na: 'x{char}y'\nb: x{char}y # {char}\nc: 1\n")
    assert plain_value(tree) == {"a": f"x{char}y", "b": f"x{char}y", "c": 1}
    assert [entry.key_span.line for entry in tree] == [2, 3, 4]


def test_in_invalid_yaml_lines_are_those_of_yaml_1_2() -> None:
    (fault,) = parse_source(SourceFile.of("f.yaml", "# \u2028\na: [1, 2\nb: 3\n")).diagnostics
    assert (fault.span.line, fault.span.text) == (2, "[1, 2")


def test_no_text_contains_a_nul_character() -> None:
    parsed = parse_source(SourceFile.of("f.yaml", 'a: "x\\0y"\n"k\\0": 1\n'))
    assert [str(fault.span) for fault in parsed.diagnostics] == ["f.yaml:1:4", "f.yaml:2:1"]
    assert parsed.tree is not None
    assert plain_value(parsed.tree) == {"a": "xy", "k": 1}


def test_a_number_of_thousands_of_digits_is_text() -> None:
    tree = parse(f"a: {'9' * 5000}\nb: 0x{'f' * 5000}\nc: 0x{'f' * 2000}")
    assert [type(value) for value in (entry.value.value for entry in tree)] == [str, str, int]
    assert kind_of(tree.entries[2].value).endswith("...")


def test_aliases_and_merge_keys_keep_the_location_of_the_value() -> None:
    tree = parse("base: &b {x: 1, y: 1}\nuse:\n  <<: *b\n  y: 2\n")
    use = tree.entries[1].value
    assert plain_value(use) == {"y": 2, "x": 1}
    assert isinstance(use, TreeMap)
    x = use.get("x")
    assert x is not None
    assert x.value.span.line == 1


def test_crlf_and_a_byte_order_mark_are_taken() -> None:
    source = decode_source("f", b"\xef\xbb\xbfa: 1\r\nb: 2\r\n")
    assert isinstance(source, SourceFile)
    tree = parse_source(source).tree
    assert isinstance(tree, TreeMap)
    assert plain_value(tree) == {"a": 1, "b": 2}
    assert [(e.key_span.line, e.key_span.column) for e in tree] == [(1, 1), (2, 1)]


@pytest.mark.parametrize(
    ("data", "reported"),
    [
        (b"a: 1\n\xff", "f:2:1: error[OBK002]: byte 0xff"),
        (b"a\r\nb\r\xff", "f:3:1: error[OBK002]: byte 0xff"),
        (b"a: \x0bx\nb\xff", "f:2:2: error[OBK002]: byte 0xff"),
        (b"\xef\xbb\xbfa: 1\nb: \xff", "f:2:4: error[OBK002]: byte 0xff"),
    ],
)
def test_invalid_utf8_is_reported_with_its_location(data: bytes, reported: str) -> None:
    assert str(decode_source("f", data)) == f"{reported} is not UTF-8"


def test_columns_count_characters_not_bytes() -> None:
    tree = parse("'ä€😀': x\n")
    assert tree.entries[0].value.span.column == 8


def test_a_file_over_ten_mebibytes_is_not_read() -> None:
    fault = decode_source("f", b"#" * (LONGEST_FILE_BYTES + 1))
    assert isinstance(fault, Diagnostic)
    assert str(fault) == ("f:1:1: error[OBK007]: the file is longer than 10 MiB, so it is not read")


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("a: 1\na: 2", "OBK004"),
        ("a: [", "OBK003"),
        ("a: *b", "OBK003"),
        ("a: &x [*x]", "OBK003"),
        ("? [a]\n: 1", "OBK003"),
        ("<<: 3", "OBK003"),
        ("? ", "OBK003"),
        ("'': 1", "OBK003"),
        ("a: \x07", "OBK003"),
        ("a: !x 1", "OBK005"),
        ("[" * 101, "OBK013"),
        ("[" * 100_000, "OBK013"),
    ],
)
def test_unreadable_files_are_findings(text: str, code: str) -> None:
    assert codes(text) == [code]


def test_a_fault_does_not_hide_the_next_one() -> None:
    assert sorted(codes("a: 1\na: 2\nb: !x 1\nc: [")) == ["OBK003", "OBK005"]


def test_numbers_and_truths_are_keys_as_written() -> None:
    assert plain_value(parse("{1: a, true: b, 2.50: c}")) == {"1": "a", "true": "b", "2.50": "c"}


def test_the_corpus_is_read_without_a_finding(repository: Path) -> None:
    corpus = repository.parent / "shared" / "corpus"
    if not corpus.is_dir():
        pytest.skip(f"there is no folder {corpus}")
    files = sorted(corpus.rglob("*.yaml"))
    assert files
    for path in files:
        source = decode_source(str(path), path.read_bytes())
        assert isinstance(source, SourceFile)
        assert parse_source(source).diagnostics == ()
