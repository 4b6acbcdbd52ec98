"""Run one test for some time: `python -m tests.fuzz.child MODULE TEST ENGINE SECONDS SEED`.

It prints one line of JSON: executions, the slowest input [s], findings.
"""

import functools
import importlib
import json
import os
import random
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, settings

from .bounds import Bounded, bound_memory

__all__ = ["main"]

CORPUS_FILES = 32
CORPUS_BYTES = 2048
"""Size of the random choices, enough for the largest inputs that the tests draw."""


def main(module: str, name: str, engine: str, seconds: float, seed: int) -> None:
    """Run a test of a module."""
    warnings.simplefilter("ignore")
    settings.register_profile(
        "fuzz",
        database=None,
        phases=[Phase.generate],
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    settings.load_profile("fuzz")
    os.environ.pop("CI", None)
    if engine == "atheris":
        import atheris

        with atheris.instrument_imports(include=["obk_cli", "obelisk_spec", "obk_interfaces"]):
            test = getattr(importlib.import_module(module), name)
    else:
        test = getattr(importlib.import_module(module), name)
    bounded = Bounded(test.hypothesis.inner_test)

    bound_memory()
    end = time.monotonic() + seconds

    @functools.wraps(bounded.test)
    def call(*arguments: Any, **options: Any) -> None:
        if time.monotonic() < end:  # a test still draws after that, but does not run
            bounded(*arguments, **options)

    test.hypothesis.inner_test = call
    if engine == "atheris":
        _explore(atheris, test.hypothesis.fuzz_one_input, bounded, end, seed)
    else:
        _generate(test, end, seed)
        _report(bounded)


def _generate(test: Any, end: float, seed: int) -> None:
    """Run with hypothesis, with one seed after another."""
    while time.monotonic() < end:
        test._hypothesis_internal_use_seed = seed
        test()
        seed += 1


def _explore(
    atheris: Any, run: Callable[[bytes], object], bounded: Bounded, end: float, seed: int
) -> None:
    """Run with atheris, on random bytes; never returns."""

    def run_one(data: bytes) -> None:
        run(data)
        if time.monotonic() > end:
            _report(bounded)
            os._exit(0)  # the library has no other exit hook for Python

    with tempfile.TemporaryDirectory() as corpus:
        draw = random.Random(seed)
        for number in range(CORPUS_FILES):
            Path(corpus, str(number)).write_bytes(draw.randbytes(CORPUS_BYTES))
        atheris.Setup([sys.argv[0], f"-seed={seed}", "-verbosity=0", corpus], run_one)
        atheris.Fuzz()


def _report(bounded: Bounded) -> None:
    reported = {"executions": bounded.executions, "slowest_s": round(bounded.slowest_s, 3)}
    print(json.dumps({**reported, "findings": bounded.findings}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3], float(sys.argv[4]), int(sys.argv[5]))
