"""Shared code for the tests of runs: a screen that stores its lines."""

from obk_cli.launch.console import Screen


class Shown(Screen):
    """A screen that stores its lines."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def put(self, line: str, *, may_drop: bool = False) -> None:
        self.lines.append(line)
