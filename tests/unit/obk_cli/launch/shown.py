"""What the tests of runs share: a screen that keeps its lines."""

from obk_cli.launch.console import Screen


class Shown(Screen):
    """A screen that keeps its lines."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def put(self, line: str, *, may_drop: bool = False) -> None:
        self.lines.append(line)
