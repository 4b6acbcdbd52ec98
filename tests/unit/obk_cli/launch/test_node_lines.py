"""The node that wrote a line of a shared output."""

from obk_cli.launch.console import NodeLines

NODES = ("/arm", "/left/arm", "/left/arm_tip", "/left")


def owners(*lines: str) -> list[str | None]:
    stream = NodeLines(NODES)
    return [stream.owner(line) for line in lines]


def logged(name: str, text: str = "text", level: str = "INFO") -> str:
    return f"[{level}] [1763712345.123456789] [{name}]: {text}"


def test_a_logged_line_is_the_nodes_of_its_logger() -> None:
    assert owners(logged("arm"), logged("left.arm"), logged("left.arm_tip", level="ERROR")) == [
        *("/arm", "/left/arm", "/left/arm_tip")
    ]


def test_a_child_logger_is_its_nearest_nodes() -> None:
    assert owners(logged("arm.rcl"), logged("left.arm.a.b"), logged("left.a")) == [
        *("/arm", "/left/arm", "/left")
    ]


def test_a_logger_of_no_node_is_the_process() -> None:
    assert owners(logged("arm"), logged("rcl"), "  more of it", logged("armature")) == [
        *("/arm", None, None, None)
    ]


def test_colors_do_not_hide_the_logger() -> None:
    assert owners(f"\x1b[31m{logged('arm')}\x1b[0m") == ["/arm"]


def test_a_printed_line_is_the_process() -> None:
    assert owners("hello", logged("arm"), "hello", "  hello") == [None, "/arm", None, None]


def test_indented_and_blank_lines_belong_to_the_one_before() -> None:
    assert owners(logged("arm"), "  more", "", "\tmore") == ["/arm"] * 4


def test_a_traceback_belongs_to_the_one_before_and_ends_with_its_exception() -> None:
    traceback = (
        "Traceback (most recent call last):",
        '  File "x.py", line 1, in f',
        "    g()",
        "KeyError: 'a'",
        "",
        "During handling of the above exception, another exception occurred:",
        "",
        "Traceback (most recent call last):",
        '  File "x.py", line 2, in f',
        "ValueError: b",
    )
    assert owners(logged("arm", level="ERROR"), *traceback, "hello") == [*["/arm"] * 11, None]
    assert owners(*traceback) == [None] * 10


def test_the_last_output_belongs_to_the_node_that_it_names() -> None:
    assert owners("/left/arm: on_error: ValueError: b", "/dev/video0: busy") == ["/left/arm", None]
