"""Digests are equal in one process and in others, in any order, whatever is recorded."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from obk_testing.trial import Schedule, StackTrial

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

EXAMPLES = Path(__file__).parents[2] / "examples"
DUMMY = EXAMPLES / "dummy" / "dummy_new.yaml"
ARM = EXAMPLES / "arm" / "arm.yaml"
QUADRUPED = EXAMPLES / "quadruped" / "quadruped.yaml"
CONFIGS = [DUMMY, ARM, QUADRUPED]
DURATION_S = 0.3
LOOP = ("/arm/est", "/arm/ctrl", "/arm/encoders")

IN_ANOTHER_PROCESS = """
import sys
from pathlib import Path
from obelisk_py.core.lockstep.interception import intercepted
with intercepted():
    from obk_testing.programs import load_stack
    from obk_testing.trial import StackTrial
    for config in sys.argv[1:]:
        stack = load_stack(Path(config))
        with StackTrial(stack, seed=3) as trial:
            print(trial.run(0.3).digest())
        stack.close()
"""

Start = Callable[..., StackTrial]


@pytest.mark.parametrize("config", CONFIGS, ids=lambda path: path.stem)
def test_runs_of_one_process_have_one_digest(start_config: Start, config: Path) -> None:
    digests = set()
    for _ in range(3):
        with start_config(config, seed=3) as trial:
            digests.add(trial.run(DURATION_S).digest())
    assert len(digests) == 1


def test_other_seeds_have_other_results(start_config: Start) -> None:
    digests = {start_config(ARM, seed=seed).run(0.1).digest() for seed in (0, 1, 2)}
    assert len(digests) == 3


def test_other_processes_hash_seeds_and_orders_have_the_same_digests(start_config: Start) -> None:
    here = [start_config(config, seed=3).run(DURATION_S).digest() for config in CONFIGS]
    for hash_seed in ("1", "2", "3"):
        backwards = hash_seed == "2"
        configs = CONFIGS[::-1] if backwards else CONFIGS
        result = subprocess.run(
            [sys.executable, "-c", IN_ANOTHER_PROCESS, *map(str, configs)],
            env={
                **os.environ,
                "PYTHONHASHSEED": hash_seed,
                "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF",
                "OMP_NUM_THREADS": "1",
                "OPENBLAS_NUM_THREADS": "1",
            },
            capture_output=True,
            text=True,
            check=True,
            timeout=200,
        )
        there = result.stdout.split()
        assert (there[::-1] if backwards else there) == here, result.stderr


def test_recording_topics_changes_nothing(start_config: Start) -> None:
    everything = start_config(ARM, seed=3).run(DURATION_S)
    some = start_config(ARM, seed=3, record=LOOP).run(DURATION_S)
    more = start_config(ARM, seed=3, watch=["/arm/wrist_force"]).run(DURATION_S)
    assert everything.digest(LOOP) == some.digest(LOOP) == more.digest(LOOP)
    assert len(more["/arm/wrist_force"]) >= 30


@pytest.mark.parametrize(
    ("config", "topic", "loop"),
    [
        (ARM, "/arm/wrist_camera", LOOP),
        (QUADRUPED, "/quadruped/heights", ("/quadruped/est", "/quadruped/ctrl")),
    ],
)
def test_pictures_and_scans_repeat_and_change_nothing(
    start_config: Start, config: Path, topic: str, loop: tuple[str, ...]
) -> None:
    plain = start_config(config, seed=3).run(DURATION_S)
    watched = [start_config(config, seed=3, watch=[topic]).run(DURATION_S) for _ in range(2)]
    assert len(watched[0][topic]) > 0
    assert watched[0].digest() == watched[1].digest()
    assert watched[0].digest(loop) == plain.digest(loop)


def test_steps_of_any_length_make_one_run(start_config: Start) -> None:
    at_once = start_config(DUMMY, seed=3).run(0.1)
    trial = start_config(DUMMY, seed=3)
    for _ in range(37):
        trial.run(0.0027)
    in_parts = trial.run(0.1 - trial.t)
    assert in_parts.digest() == at_once.digest()


def test_another_stack_in_between_changes_nothing(start_config: Start) -> None:
    schedule = Schedule(latency=0.001, jitter=0.002, phases=True, compute={"control": 0.001})
    before = start_config(ARM, seed=3, schedule=schedule).run(DURATION_S).digest()
    other = start_config(DUMMY, seed=4)
    trial = start_config(ARM, seed=3, schedule=schedule)
    for _ in range(3):
        trial.run(DURATION_S / 3)
        other.run(0.05)
    assert trial.result().digest() == before


@pytest.mark.parametrize("config", CONFIGS, ids=lambda path: path.stem)
def test_simulated_time_by_parameter_makes_the_same_trajectory(
    start_config: Start, config: Path
) -> None:
    sections = ("robot", "estimation", "control")
    overrides = [f"{section}.params.use_sim_time=true" for section in sections]
    plain = start_config(config, seed=3).run(DURATION_S)
    trial = start_config(config, *overrides, seed=3)
    simulated = trial.run(DURATION_S)
    assert (plain.qpos == simulated.qpos).all()
    assert all(node.get_parameter("use_sim_time").value for node in trial.nodes.values())
