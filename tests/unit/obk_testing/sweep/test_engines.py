"""The local engine of a sweep, with workers that do not start processes."""

from pathlib import Path

import pytest

from obk_testing.sweep.cases import Row, SweepCase
from obk_testing.sweep.engines import LocalEngine, RestartingWorker

CASES = [SweepCase(test="t", node_id=f"t[seed{seed}]", seed=seed) for seed in range(4)]


def test_every_case_runs_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        RestartingWorker, "run", lambda _, case: Row(key=case.key, outcome="passed")
    )
    with LocalEngine(tmp_path, (), tmp_path, workers=2, limit_s=1.0) as engine:
        keys = [placed.row.key for placed in engine.map(CASES)]
    assert sorted(keys) == sorted(case.key for case in CASES)


def test_an_index_error_in_a_worker_ends_the_sweep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: RestartingWorker, case: SweepCase) -> Row:
        raise IndexError(case.key)

    monkeypatch.setattr(RestartingWorker, "run", fail)
    with (
        LocalEngine(tmp_path, (), tmp_path, workers=2, limit_s=1.0) as engine,
        pytest.raises(IndexError),
    ):
        list(engine.map(CASES))
