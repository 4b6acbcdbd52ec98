"""A stack of thirty nodes starts and stops, with one process per node and composed."""

from pathlib import Path

import pytest
import yaml

from .stack import DEADLINE_S, marked, started

pytestmark = [pytest.mark.ros, pytest.mark.slow]
PAIRS = 14


def thirty_nodes(repository: Path, folder: Path) -> Path:
    """A config of one robot, fourteen estimators and fifteen controllers at 20 Hz."""
    dummy = repository / "examples" / "dummy"
    config = yaml.safe_load((dummy / "dummy_new.yaml").read_text(encoding="utf-8"))
    robot, estimator, controller = (config[s] for s in ("robot", "estimation", "control"))
    robot["sim"]["model_xml_path"] = str(dummy / "dummy.xml")
    robot["sim"]["sensor_settings"] = [robot["sim"]["sensor_settings"][0] | {"dt": 0.05}]
    controller["params_path"] = str(dummy / controller["params_path"])
    config["config"] = "thirty"
    config["estimation"] = [_at(estimator, f"/est{n}", None) for n in range(PAIRS)]
    config["control"] = [_at(controller, f"/ctrl{n}", f"/est{n % PAIRS}") for n in range(PAIRS + 1)]
    robot["subscribers"][0]["topic"] = "/ctrl0"
    path = folder / "thirty.yaml"
    path.write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")
    return path


def _at(node: dict[str, list[dict[str, object]]], publishes: str, subscribes: str | None) -> object:
    copy = yaml.safe_load(yaml.safe_dump(node))
    copy["publishers"][0]["topic"] = publishes
    if subscribes is not None:
        copy["subscribers"][0]["topic"] = subscribes
    copy["timers"][0]["timer_period_sec"] = 0.05
    return copy


@pytest.mark.parametrize("options", [(), ("--composed",)], ids=["apart", "composed"])
def test_thirty_nodes_start_and_stop(
    repository: Path, tmp_path: Path, options: tuple[str, ...]
) -> None:
    config = thirty_nodes(repository, tmp_path)
    with started(config, "--quiet", "--duration", "1", *options) as run:
        # Thirty processes take ten times as long as the three in the other tests.
        assert run.process.wait(5 * DEADLINE_S) == 0, run.text
    assert run.text.count(": activate ok") == 30
    assert run.text.count("shutdown ok") == 30
    assert not marked()
