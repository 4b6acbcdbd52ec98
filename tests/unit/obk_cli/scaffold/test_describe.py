"""The diff of the changes that a command would make."""

from pathlib import PurePosixPath

import pytest

from obk_cli.scaffold.describe import unified_diff
from obk_cli.scaffold.templates import RenderedFile
from obk_cli.scaffold.write import Action, Decision


@pytest.mark.parametrize("mark", ["\f", "\v", "\x1c", "\x85", "\u2028", "\r"])
def test_a_line_ends_as_patch_expects(mark: str) -> None:
    edit = Decision(
        file=RenderedFile(path=PurePosixPath("a.py"), content=f"a{mark}b\nd\n".encode()),
        action=Action.EDIT,
        before=f"a{mark}b\nc\n".encode(),
    )
    assert unified_diff([edit]) == (f"--- a/a.py\n+++ b/a.py\n@@ -1,2 +1,2 @@\n a{mark}b\n-c\n+d\n")
