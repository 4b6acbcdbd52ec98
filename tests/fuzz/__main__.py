"""Run the property tests in turn and write the results."""

import argparse
import importlib
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib.util import find_spec
from inspect import signature
from pathlib import Path
from typing import Any, Final

__all__ = ["main"]

ROOT: Final = Path(__file__).resolve().parents[2]
RESULT: Final = ROOT / "build" / "benchmarks" / "fuzz.json"
ENGINES: Final = ("hypothesis", "atheris")
START_S: Final = 120.0
"""Time for a process to load everything and to exit [s]."""


def tests() -> Iterator[tuple[str, str]]:
    """Module and name of all property tests that need no fixture."""
    for path in sorted((ROOT / "tests" / "property").glob("test_*.py")):
        try:
            module = importlib.import_module(f"tests.property.{path.stem}")
        except ImportError as error:
            print(f"{path.stem} is left out: {error.msg.splitlines()[0]}", file=sys.stderr)
            continue
        for name, test in vars(module).items():
            if name.startswith("test_") and hasattr(test, "hypothesis") and _is_alone(test):
                yield module.__name__, name


def _is_alone(test: Any) -> bool:
    return not signature(test).parameters


def run(module: str, name: str, engine: str, seconds: float, seed: int) -> dict[str, Any]:
    """Run one test in its own process."""
    command = (
        sys.executable,
        "-m",
        "tests.fuzz.child",
        module,
        name,
        engine,
        str(seconds),
        str(seed),
    )
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "TMPDIR": folder, "XDG_CACHE_HOME": folder, "OBK_HOME": folder}
        try:
            done = subprocess.run(
                command,
                cwd=ROOT,
                env=environment,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=seconds + START_S,
                check=False,
            )
            lines = done.stdout.splitlines()
            end = f"exit code {done.returncode}: {done.stderr[-1000:]}" if done.returncode else ""
        except subprocess.TimeoutExpired:
            lines, end = [], f"no end within {seconds + START_S:g} s"
    reported = next((json.loads(line) for line in lines if line.startswith('{"executions"')), None)
    result = reported or {"executions": 0, "slowest_s": 0.0, "findings": {}}
    if end or reported is None:
        result["findings"]["process"] = end or "it reported nothing"
    return {"test": f"{module.rpartition('.')[2]}.{name}", **result, "seconds": _since(begin)}


def _since(begin: float) -> float:
    return round(time.monotonic() - begin, 1)


def _with_earlier(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Results of some tests, merged with earlier results of the others."""
    earlier = json.loads(RESULT.read_text(encoding="utf-8"))["tests"] if RESULT.exists() else []
    merged = {(result["engine"], result["test"]): result for result in (*earlier, *results)}
    return list(merged.values())


def main() -> int:
    """Share the time among the tests."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("--seconds", type=float, default=60.0, help="for all tests together")
    parser.add_argument("--only", nargs="+", default=[""], help="tests with one of these in them")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--engine", choices=ENGINES, help="else each that is installed")
    options = parser.parse_args()
    there = ENGINES if find_spec("atheris") else ENGINES[:1]
    engines = (options.engine,) if options.engine else there
    wanted = [test for test in tests() if any(part in ".".join(test) for part in options.only)]
    share_s = options.seconds / max(1, len(wanted) * len(engines))
    results = []
    for engine in engines:
        for module, name in wanted:
            result = {"engine": engine, **run(module, name, engine, share_s, options.seed)}
            print(f"{result['executions']:>8} {len(result['findings'])} {engine} {result['test']}")
            for where, what in result["findings"].items():
                print(f"         {where}: {what}")
            results.append(result)
    if options.only != [""] or options.engine:
        results = _with_earlier(results)
    reported = {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "seed": options.seed,
        "seconds": round(sum(result["seconds"] for result in results), 1),
        "executions": sum(result["executions"] for result in results),
        "findings": sum(len(result["findings"]) for result in results),
        "tests": results,
    }
    RESULT.parent.mkdir(parents=True, exist_ok=True)
    RESULT.write_text(json.dumps(reported, indent=1) + "\n", encoding="utf-8")
    print(f"{reported['executions']} executions, {reported['findings']} findings: {RESULT}")
    return 1 if reported["findings"] else 0


if __name__ == "__main__":
    sys.exit(main())
