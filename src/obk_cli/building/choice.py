"""Which packages of a survey a build takes, and which commands colcon is given for them.

Pure: names in, names out.
"""

from collections.abc import Collection, Sequence

from obelisk_spec.suggestions import did_you_mean
from obk_cli.building.survey import Survey, Surveyed
from obk_cli.errors import MisuseError

__all__ = ["choose", "colcon_command"]


def choose(survey: Survey, names: Collection[str], *, present: Collection[str]) -> list[Surveyed]:
    """The packages that a build takes, in build order; without names, all.

    With names: those, what they need, and of those that are `present` in the overlay the ones that
    use them: a message must not stay compiled against an older one that is in it.

    Raises:
        MisuseError: the workspace has no message package of a name.
    """
    known = {one.name: one for one in survey.packages}
    for name in names:
        if name not in known:
            raise MisuseError(
                f"there is no message package `{name}` in {survey.workspace}",
                help=did_you_mean(name, known) or "`obk new msgs my_msgs` makes one",
            )
    chosen = set(names or known)
    for one in reversed(survey.packages):
        if one.name in chosen:
            chosen.update(known.keys() & set(one.package.depends))
    for one in survey.packages:
        if one.name in present and not chosen.isdisjoint(one.package.depends):
            chosen.add(one.name)
    return [one for one in survey.packages if one.name in chosen and one.state != "installed"]


def colcon_command(colcon: str, packages: Sequence[str], *, jobs: int | None) -> tuple[str, ...]:
    """The arguments that have colcon build these packages of the folder it is started in."""
    workers = ("--parallel-workers", str(jobs)) if jobs is not None else ()
    return (colcon, "build", *workers, "--packages-select", *packages)
