"""The cases of a sweep and their results. A case is a test with a seed and changes to the config.

Cases depend only on the command line and the tests, so every engine (local workers or Dask) runs
the same cases, with any number of workers.
"""

import hashlib
import json
import random
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, Final, Literal

from obelisk_spec.suggestions import did_you_mean, with_number
from obk_cli.config.loader import ConfigFiles, load_config
from obk_cli.config.tree import Tree, TreeList, TreeMap, TreeScalar, kind_of
from obk_cli.config.yaml_parser import decode_source
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import SourceFile
from obk_cli.errors import MisuseError
from obk_cli.files import read_bytes

__all__ = [
    "FoundTest",
    "Outcome",
    "Row",
    "SweepCase",
    "Varied",
    "files_of_config",
    "make_cases",
    "parse_varied",
    "with_types_of_config",
]

Outcome = Literal["passed", "failed", "skipped", "died"]
_SEED: Final = re.compile(r"(?<=[\[-])seed0(?=[\]-])")
"""The part of a test's id that pytest generates for the first seed."""
_NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE: Final = re.compile(rf"({_NUMBER})\.\.({_NUMBER})(?::(\d+))?")
_DIGITS: Final = 6
"""Significant digits of a random value, few enough that the value is easy to retype."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundTest:
    """A test that uses the `stack` fixture."""

    node_id: str
    """The test's pytest id, relative to the config's folder. For a test that uses `seed`, the id
    for seed 0."""
    takes_seed: bool

    @property
    def name(self) -> str:
        """The id without the seed: `tests/test_arm.py::test_push[8]`."""
        if not self.takes_seed:
            return self.node_id
        name = _SEED.sub("", self.node_id, count=1)
        return name.replace("[-", "[").replace("--", "-").replace("-]", "]").removesuffix("[]")

    def node_id_of(self, seed: int) -> str:
        """Return the id for a seed."""
        return _SEED.sub(f"seed{seed}", self.node_id, count=1) if self.takes_seed else self.node_id


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepCase:
    """One run of one test."""

    test: str
    """Test id without the seed."""
    node_id: str
    seed: int | None
    """None if the test does not use `seed`."""
    overrides: tuple[tuple[str, str], ...] = ()
    """Path in the config -> value, as for `--set`."""

    @property
    def key(self) -> str:
        """Identifies the case across sweeps."""
        text = json.dumps([self.node_id, self.overrides])
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def settings(self) -> tuple[str, ...]:
        """The overrides in the form of `--set`."""
        return tuple(f"{path}={value}" for path, value in self.overrides)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """The result of a case."""

    key: str
    outcome: Outcome
    why: str = ""
    """The first line of the failed assertion, or another reason."""
    metrics: Mapping[str, Any] = field(default_factory=dict)
    """Values that the test recorded with `record_property`."""
    digest: str = ""
    """Digest of all trials of the case; empty if it started none."""
    seconds: float = 0.0
    """Wall time [s]."""
    worker: str = ""
    unused: Sequence[str] = ()
    """Paths of overrides that the case did not use; not stored."""
    files: Sequence[str] = ()
    """Absolute paths of files that its tests and nodes have read, unless an earlier row of the
    worker has them; not stored in the row."""

    @property
    def is_bad(self) -> bool:
        """Whether the case failed or could not be run."""
        return self.outcome in ("failed", "died")

    def data(self) -> dict[str, Any]:
        """Return the row as a dict that can be written as JSON."""
        return asdict(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Varied:
    """A value in the config that is varied."""

    path: str
    low: float = 0.0
    high: float = 0.0
    steps: int | None = None
    """Number of grid points in the range; None if not given."""
    values: tuple[str, ...] = ()
    """The values of a list; empty for a range."""
    is_integer: bool = False

    def ends(self) -> tuple[str, ...]:
        """Values to check before the first case: the ends of the range, or the whole list."""
        return self.values or (self._text(self.low), self._text(self.high))

    def grid(self) -> tuple[str, ...]:
        """Return all values of a grid.

        Raises:
            MisuseError: the number of values in a range is not given.
        """
        if self.values:
            return self.values
        if self.steps is None:
            raise MisuseError(
                f"`--vary {self.path}`: a grid needs the number of values in the range",
                help=f"append it to the range: `{self.path}={self.low:g}..{self.high:g}:5`",
            )
        last = max(self.steps - 1, 1)
        width = self.high - self.low
        drawn = (self._text(self.low + width * step / last) for step in range(self.steps))
        return tuple(dict.fromkeys(drawn))

    def sample(self, count: int) -> list[str]:
        """Draw one value from each of `count` equal parts of the range, in random order.

        The order depends only on the path and the count.

        Raises:
            MisuseError: the number of values in the range is given.
        """
        if self.steps is not None:
            raise MisuseError(
                f"`--vary {self.path}`: the number of values in a range, `:{self.steps}`, needs "
                "`--grid`",
                help=f"add `--grid`, or draw {self.steps} samples with `--seeds {self.steps}` and "
                "without the number",
            )
        draw = random.Random(f"obk sweep {self.path} {count}")  # noqa: S311 - not for security
        parts = list(range(count))
        draw.shuffle(parts)
        if self.values:
            return [self.values[part * len(self.values) // count] for part in parts]
        width = self.high - self.low
        return [self._text(self.low + width * (part + draw.random()) / count) for part in parts]

    def _text(self, value: float) -> str:
        return str(round(value)) if self.is_integer else repr(float(f"{value:.{_DIGITS}g}"))


def parse_varied(text: str) -> Varied:
    """Parse `PATH=LOW..HIGH`, `PATH=LOW..HIGH:COUNT` or `PATH=VALUE,VALUE,...`.

    Raises:
        MisuseError: the text has none of these forms.
    """
    path, equals, values = text.partition("=")
    found = _RANGE.fullmatch(values)
    if not equals or not path or not values:
        raise MisuseError(
            f"`--vary {text}`: expected PATH=RANGE",
            help="for example `control.params.gain=50..200` or `control.params.mode=soft,stiff`",
        )
    if found is None:
        listed = tuple(value.strip() for value in values.split(","))
        if len(listed) < 2 or not all(listed):
            raise MisuseError(
                f"`--vary {text}`: `{values}` is neither a range nor a list",
                help="write `PATH=50..200` or `PATH=1,2,5`",
            )
        return Varied(path=path, values=listed)
    low, high = float(found[1]), float(found[2])
    steps = None if found[3] is None else int(found[3])
    if low >= high or steps == 0:
        raise MisuseError(f"`--vary {text}`: the range `{values}` is empty")
    return Varied(path=path, low=low, high=high, steps=steps)


def with_types_of_config(
    varied: Sequence[Varied], config: Path, variables: Mapping[str, str]
) -> tuple[Varied, ...]:
    """Check that the config contains the values to vary; a range for an integer yields integers.

    Raises:
        MisuseError: a path does not exist, or its value has another type.
    """
    tree, _ = _load(config, variables)
    paths = [each.path for each in varied]
    if repeated := {path for path in paths if paths.count(path) > 1}:
        raise MisuseError(f"`--vary {min(repeated)}` is given twice")
    return tuple(_typed(each, _value_at(tree, each.path)) for each in varied)


def files_of_config(config: Path, variables: Mapping[str, str]) -> tuple[Path, ...]:
    """Return the config and the files that it includes."""
    return tuple(Path(source.path).absolute() for source in _load(config, variables)[1])


def _load(config: Path, variables: Mapping[str, str]) -> tuple[Tree | None, Sequence[SourceFile]]:
    """Load the values of a config with its includes, and their source files."""
    data = read_bytes(str(config))
    if isinstance(data, str):
        raise MisuseError(f"`{config}` cannot be read: {data}")
    source = decode_source(str(config), data)
    if isinstance(source, Diagnostic):
        raise MisuseError(f"{config}: {source.message}")
    files = ConfigFiles(source, variables=variables, working_folder=Path.cwd(), read=read_bytes)
    tree, _ = load_config(source, files, ())
    return tree, files.sources


def _typed(varied: Varied, found: TreeScalar) -> Varied:
    place = f"{found.span.path}:{found.span.line}:{found.span.column}"
    is_number = isinstance(found.value, int | float) and not isinstance(found.value, bool)
    if varied.values:
        return varied
    if not is_number:
        raise MisuseError(
            f"`--vary {varied.path}`: a range needs a number, but the value is {kind_of(found)} "
            f"({place})",
            help=f"list its values: `{varied.path}=A,B`",
        )
    if not isinstance(found.value, int):
        return varied
    if not (varied.low.is_integer() and varied.high.is_integer()):
        raise MisuseError(
            f"`--vary {varied.path}`: the value is an integer ({place}), but "
            f"{varied.low:g}..{varied.high:g} is not a range of integers",
            help="to vary it continuously, write it in the config with a decimal point",
        )
    return Varied(
        path=varied.path, low=varied.low, high=varied.high, steps=varied.steps, is_integer=True
    )


def _value_at(tree: Tree | None, path: str) -> TreeScalar:
    """Return the scalar at a path in the config."""
    done = ""
    for step in re.findall(r"[^.\[\]]+|\[\d+\]", path):
        if step.startswith("["):
            tree = _item(tree, int(step[1:-1]), path, done)
        else:
            tree = _entry(tree, step, path, done)
        done = f"{done}{step}" if step.startswith("[") else f"{done}.{step}".lstrip(".")
    if isinstance(tree, TreeScalar):
        return tree
    what = "nothing" if tree is None else kind_of(tree)
    first = "[0]" if isinstance(tree, TreeList) else ".NAME"
    raise MisuseError(
        f"`--vary {path}`: expected a single value, found {what}",
        help=f"vary one of its values, such as `{path}{first}`",
    )


def _item(tree: Tree | None, number: int, path: str, done: str) -> Tree | None:
    if isinstance(tree, TreeMap) and number == 0:
        return tree  # a mapping counts as a list of one
    if not isinstance(tree, TreeList) or number >= len(tree.items):
        count = len(tree.items) if isinstance(tree, TreeList) else 0
        raise MisuseError(
            f"`--vary {path}`: `{done}` has {with_number(count, 'item')}, so there is no [{number}]"
        )
    return tree.items[number]


def _entry(tree: Tree | None, key: str, path: str, done: str) -> Tree | None:
    if isinstance(tree, TreeList):
        raise MisuseError(
            f"`--vary {path}`: `{done}` is a list",
            help=f"select an item, such as `{done}[0].{key}`",
        )
    entry = tree.get(key) if isinstance(tree, TreeMap) else None
    if entry is None:
        known = [each.key for each in tree] if isinstance(tree, TreeMap) else []
        raise MisuseError(
            f"`--vary {path}`: {f'`{done}`' if done else 'the config'} has no `{key}`",
            help=did_you_mean(key, known)
            or (f"it has {', '.join(known)}" if known else "write the value in the config first"),
        )
    return entry.value


def make_cases(
    tests: Sequence[FoundTest],
    *,
    seeds: int,
    varied: Sequence[Varied] = (),
    is_grid: bool = False,
    overrides: Sequence[str] = (),
) -> tuple[SweepCase, ...]:
    """Return all cases, in order.

    Args:
        tests: the tests to run at every point.
        seeds: number of seeds; with `varied` and no grid, also the number of samples, because each
            sample has its own seed.
        varied: the varied values.
        is_grid: whether to combine all values with every seed; if not, they form a Latin hypercube.
        overrides: `path=value` for all cases.
    """
    fixed = [(path, value) for path, _, value in (each.partition("=") for each in overrides)]
    paths = [each.path for each in varied]
    points: list[tuple[int, tuple[str, ...]]]
    if is_grid:
        combinations = product(*(each.grid() for each in varied))
        points = [(seed, values) for values in combinations for seed in range(seeds)]
    else:
        samples = [each.sample(seeds) for each in varied]
        points = [(seed, tuple(column[seed] for column in samples)) for seed in range(seeds)]
    cases: dict[SweepCase, None] = {}
    for seed, values in points:
        changes = (*fixed, *zip(paths, values, strict=True))
        for test in tests:
            case = SweepCase(
                test=test.name,
                node_id=test.node_id_of(seed),
                seed=seed if test.takes_seed else None,
                overrides=changes,
            )
            cases[case] = None
    return tuple(cases)
