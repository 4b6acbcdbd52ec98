"""The escape sequences of a node that reach the terminal."""

import pytest

from obk_cli.terminal import escaped, only_colour, plain, visible


@pytest.mark.parametrize(
    "sequence",
    [
        "\x1b[2J",
        "\x1b[?1049h",
        "\x1b[>0q",
        "\x1b[1;1H",
        "\x1b[?25l",
        "\x9b2J",
        "\x1b]0;title\x07",
        "\x1b]52;c;aGk=\x1b\\",
        "\x1b]8;;http://x\x1b\\",
        "\x1bPq#0\x1b\\",
        "\x1b_Gf=100\x1b\\",
        "\x1bc",
        "\x1b(0",
        "\x1b7",
        "\x07",
        "\x08",
        "\r",
        "\x0b",
        "\x00",
        "\x7f",
    ],
)
def test_other_escape_sequences_than_colors_are_removed(sequence: str) -> None:
    assert only_colour(f"a{sequence}b") == "ab"
    assert plain(f"a{sequence}b") == "ab"


def test_colors_pass_and_are_ended() -> None:
    assert only_colour("\x1b[1;31mred\x1b[0m") == "\x1b[1;31mred\x1b[0m"
    assert only_colour("\x1b[38;2;1;2;3mred") == "\x1b[38;2;1;2;3mred\x1b[0m"
    assert plain("\x1b[1;31mred\x1b[0m") == "red"


def test_a_sequence_that_does_not_end_takes_no_other_line_along() -> None:
    assert only_colour("a\x1b]0;title") == "a"
    assert only_colour("a\x1b[") == "a"
    assert only_colour("a\x1b") == "a"


def test_tabs_and_letters_of_all_languages_stay() -> None:
    assert only_colour("\tgrün 机器人 °") == "\tgrün 机器人 °"


def test_invalid_utf8_is_removed() -> None:
    assert plain(b"caf\xe9".decode(errors="surrogateescape")) == "caf"


def test_characters_that_must_not_be_lost_are_escaped() -> None:
    assert escaped("a\x1b[2J\x9b31m\n\tb\x7f") == r"a\u001b[2J\u009b31m\n\tb\u007f"
    assert escaped("\u202etxt\u2028") == r"\u202etxt\u2028"
    assert escaped("grün 机器人 °") == "grün 机器人 °"


def test_columns_are_kept_if_control_characters_are_shown_as_symbols() -> None:
    assert visible("a\x1b[2J\tb\x00") == "a\ufffd[2J\tb\ufffd"
