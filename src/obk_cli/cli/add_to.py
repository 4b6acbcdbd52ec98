"""`obk new ... --add-to CONFIG`: the new node's entry in a config, planned, then written.

In: which config, and the answers. Out: the edit, to be written as the last step of making the
package; a config that cannot take the node stops everything before anything is made.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from obk_cli.cli.config_options import make_options
from obk_cli.cli.edit_files import EditedFile, open_for_edit, write_edited
from obk_cli.cli.findings import print_findings
from obk_cli.cli.join_wish import JoinWish
from obk_cli.compiler import compile_source
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import SourceFile
from obk_cli.errors import CommandFailedError
from obk_cli.joining.join import Joined, join_node
from obk_cli.joining.newcomer import read_newcomer
from obk_cli.joining.proof import new_errors
from obk_cli.joining.refusal import Refused
from obk_cli.joining.suit import suit_types
from obk_cli.joining.target import find_replaced
from obk_cli.joining.tell import joined_lines, joined_values
from obk_cli.report.diff import report_diff
from obk_cli.scaffold.describe import Added
from obk_cli.scaffold.kinds import SECTIONS
from obk_cli.scaffold.questions import Answers, Question
from obk_cli.scaffold.snippet import config_snippet

__all__ = ["ConfigEdit", "add_to_config", "suit_to_config"]

_OPTIONS: Mapping[str, str] = {
    "ctrl": "--ctrl-msg",
    "est": "--est-msg",
    "sensor": "--sensor-msg",
}
"""The option that says the type of `pub_ctrl`, `sub_ctrl` and so on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfigEdit:
    """A config's new text, not yet written."""

    joined: Joined
    _file: EditedFile
    _is_built_later: bool
    """Whether the node's executable is there only after a build."""

    def write(self) -> None:
        """Replace the config, once the package is there and the whole is sound with it.

        Raises:
            CommandFailedError: it is not, or the file has changed or cannot be written.
        """
        if not self._is_built_later:
            source = SourceFile.of(self.joined.source.path, self.joined.text)
            after = compile_source(source, make_options(None, None)).diagnostics
            errors = new_errors(self.joined.before, after)
            if errors:
                print_findings(errors)
                raise CommandFailedError(
                    f"with the new node `{source.path}` would have errors that it does not have "
                    "now; nothing was made",
                    help="see the errors above",
                )
        write_edited(self._file, self.joined.text)

    def tell(self, *, is_done: bool) -> Added:
        """What was, or would be, done to the config."""
        source, text = self.joined.source, self.joined.text
        later = "note: until it is built, `obk validate` says that there is no such executable"
        return Added(
            config=source.path,
            lines=(
                *joined_lines(self.joined, is_done=is_done),
                *((later,) if self._is_built_later else ()),
            ),
            values=joined_values(self.joined),
            diff=report_diff(source, text, colour=False),
        )


def add_to_config(wish: JoinWish, answers: Answers) -> ConfigEdit:
    """The edit that puts the new node into the config; nothing is written.

    Raises:
        CommandFailedError: the config cannot be read, or cannot take the node.
    """
    file = open_for_edit(wish.config)
    if isinstance(file, Diagnostic):
        print_findings((file,))
        raise CommandFailedError(f"`{wish.config}` cannot be read; nothing was made")
    joined = join_node(
        file.source,
        read_newcomer(SECTIONS[answers.kind], config_snippet(answers)),
        make_options(None, None),
        device=wish.device,
        replaces=wish.replaces,
    )
    if isinstance(joined, Refused):
        raise _refusal(joined)
    return ConfigEdit(joined=joined, _file=file, _is_built_later=answers.language == "cpp")


def suit_to_config(question: Question, wish: JoinWish, usual: Answers) -> Question:
    """The question with the message types that were left open as the config has them.

    `usual` is what they would be else. What is wrong with the config is told when the node joins.
    """
    file = open_for_edit(wish.config)
    stack = None
    if not isinstance(file, Diagnostic):
        stack = compile_source(file.source, make_options(None, None)).config
    if stack is None:
        return question
    newcomer = read_newcomer(SECTIONS[usual.kind], config_snippet(usual))
    replaced = find_replaced(stack, newcomer.section, wish.replaces) if wish.replaces else None
    if isinstance(replaced, Refused):
        return question
    types = {
        component.partition("_")[2]: full
        for component, full in suit_types(newcomer, stack, replaced).items()
    }
    return replace(
        question,
        ctrl_msg=question.ctrl_msg or types.get("ctrl"),
        est_msg=question.est_msg or types.get("est"),
        sensor_msg=question.sensor_msg or types.get("sensor"),
    )


def _refusal(refused: Refused) -> CommandFailedError:
    print_findings(refused.findings)
    option = _OPTIONS.get((refused.component or "").partition("_")[2])
    help = f"{refused.help} with `{option}`" if option else refused.help
    return CommandFailedError(f"{refused.sentence}; nothing was made", help=help)
