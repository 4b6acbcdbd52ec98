"""Draw DOT texts with Graphviz, by the extra `graph`; a graph as a PNG picture."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final, Literal

from obk_cli.emit.dot import emit_dot
from obk_cli.emit.graph import Graph
from obk_cli.errors import CommandFailedError
from obk_cli.optional_deps import require_extra

__all__ = ["draw", "emit_png"]

# Graphviz is C, and prints warnings about fonts: both stay in a process of their own. Boxes have
# the sizes of the DOT text, whatever the fonts of the machine.
_PROGRAM: Final = """
import sys, pygraphviz
graph = pygraphviz.AGraph(string=sys.stdin.buffer.read().decode())
graph.node_attr["fixedsize"] = "true"
graph.graph_attr["dpi"] = sys.argv[2]
sys.stdout.buffer.write(graph.draw(format=sys.argv[1], prog="dot"))
"""
_NO_FONTS: Final = "<fontconfig></fontconfig>\n"
_DRAW_S: Final = 60.0
_DPI: Final = {"svg": 72, "png": 144}
"""A point of an SVG is a pixel; a PNG is for screens with twice as many."""
_FONT_FOLDERS: Final = ("/usr/share/fonts", "/usr/local/share/fonts", "~/.local/share/fonts")
_FONT_ENDINGS: Final = (".ttf", ".otf", ".ttc", ".pfb")


def emit_png(graph: Graph) -> bytes:
    """The graph as a PNG, with the fonts of this machine.

    Raises:
        CommandFailedError: the extra `graph` is not installed, there is no font, or Graphviz
            failed.
    """
    folders = [Path(folder).expanduser() for folder in _FONT_FOLDERS]
    files = (file for folder in folders for file in folder.rglob("*"))
    if not any(file.suffix.lower() in _FONT_ENDINGS for file in files):
        raise CommandFailedError(
            "a PNG needs a font, and this machine has none",
            help="install one, such as the package `fonts-dejavu-core`, or draw an SVG",
        )
    return draw(emit_dot(graph), "png")


def draw(dot: str, form: Literal["svg", "png"]) -> bytes:
    """The picture of a DOT text; an SVG has the same layout on every machine.

    Raises:
        CommandFailedError: the extra `graph` is not installed, or Graphviz failed.
    """
    require_extra("pygraphviz", "graph")
    environment = dict(os.environ)
    try:
        with tempfile.TemporaryDirectory(prefix="obk-graph-") as folder:
            if form == "svg":  # its text is drawn by the viewer
                fonts = Path(folder, "fonts.conf")
                fonts.write_text(_NO_FONTS, encoding="utf-8")
                environment["FONTCONFIG_FILE"] = str(fonts)
            ended = subprocess.run(
                (sys.executable, "-P", "-c", _PROGRAM, form, str(_DPI[form])),
                capture_output=True,
                check=False,
                env=environment,
                input=dot.encode(),
                timeout=_DRAW_S,
            )
    except subprocess.TimeoutExpired as error:
        raise CommandFailedError(
            f"Graphviz did not finish within {_DRAW_S:.0f} s", help="`--to dot` needs no layout"
        ) from error
    if ended.returncode != 0:
        last = ended.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise CommandFailedError(f"Graphviz failed: {last or f'exit code {ended.returncode}'}")
    return ended.stdout
