"""Events about the rates of nodes, and strict rates, in a fake world."""

from collections import deque
from dataclasses import replace

import pytest

from obelisk_spec.runtime_protocol import Rate
from obelisk_spec.video import VideoStatus
from obk_cli.launch.events import (
    InputEvent,
    OutputEvent,
    ProcessEnded,
    RateBroken,
    RateKept,
    RateMoved,
    RatesReported,
    RatesUnreported,
    StateSeen,
    StatusRequested,
    StopRequested,
    VideoReported,
)
from obk_cli.launch.external_rates import external_rate
from obk_cli.plan.plan import Origin, Plan, PlannedRate
from obk_cli.ros.meters import TopicRate
from obk_cli.runs.protocol import StackStatus

from .world import CONTROLLER, ESTIMATOR, PLAN, ROBOT, World, rates

PERIOD = PlannedRate(name="timer", period_s=0.01, origin=Origin(path="c.yaml", line=7, column=21))
PROMISED = replace(
    PLAN,
    nodes=tuple(replace(p, rates=(PERIOD,)) if p.section == "control" else p for p in PLAN.nodes),
)
OFF, BROKEN = rates(CONTROLLER, 80, "off"), rates(CONTROLLER, 50, "broken")
KEPT = rates(CONTROLLER, 100)


def seconds(*reports: RatesReported | None) -> deque[InputEvent | float]:
    """One report per second; None for a second without one."""
    return deque(step for report in reports for step in ([report] if report else []) + [1.0])


def reported_of_rates(world: World) -> list[OutputEvent]:
    return [e for e in world.published if isinstance(e, RateBroken | RateKept | RateMoved)]


def test_a_kept_rate_is_not_reported() -> None:
    world = World(plan=PROMISED, later=seconds(KEPT, KEPT, KEPT))
    assert world.run(duration_s=3).exit_code == 0
    assert reported_of_rates(world) == []


def test_a_rate_that_breaks_is_reported_once_and_once_when_it_is_kept_again() -> None:
    world = World(plan=PROMISED, later=seconds(KEPT, OFF, BROKEN, BROKEN, BROKEN, KEPT, KEPT))
    assert world.run(duration_s=7).exit_code == 0
    moved, broken, kept = reported_of_rates(world)
    assert isinstance(moved, RateMoved)
    assert isinstance(broken, RateBroken)
    assert isinstance(kept, RateKept)
    assert broken.how == ("timer runs at 50 of 100 Hz (p99 latency 2.5 ms); set at c.yaml:7:21")


def test_of_ticks_that_cannot_be_late_only_their_number_is_reported() -> None:
    rate = Rate(
        name="/arm/camera",
        expected_hz=10.0,
        measured_hz=1.25,
        ticks=5,
        overruns=40,
        late_p50_us=0.0,
        late_p99_us=0.0,
        late_max_us=0.0,
        standing="broken",
    )
    broken = RateBroken(node="/robot", rate=rate, origin="c.yaml:7:21")
    assert broken.how == "/arm/camera runs at 1.25 of 10 Hz; set at c.yaml:7:21"


def test_a_broken_rate_is_reported_again_only_if_it_has_changed() -> None:
    later = seconds(BROKEN, rates(CONTROLLER, 54, "broken"), rates(CONTROLLER, 57, "broken"))
    world = World(plan=PROMISED, later=later)
    world.run(duration_s=3)
    assert [event.rate.measured_hz for event in reported_of_rates(world)] == [50, 57]  # type: ignore[union-attr]


def test_a_short_deviation_is_reported_but_not_as_broken() -> None:
    world = World(plan=PROMISED, strict_rates=True, later=seconds(KEPT, OFF, KEPT))
    assert world.run(duration_s=3).exit_code == 0
    assert [type(event) for event in reported_of_rates(world)] == [RateMoved, RateMoved]


def test_with_strict_rates_a_broken_one_ends_the_run_and_is_named() -> None:
    world = World(plan=PROMISED, strict_rates=True, later=seconds(KEPT, OFF, BROKEN, KEPT))
    ended = world.run(duration_s=9)
    assert ended.exit_code == 1
    assert ended.cause == (
        "/obelisk_control_0: timer runs at 50 of 100 Hz (p99 latency 2.5 ms); set at c.yaml:7:21"
    )
    assert world.transitions_of(CONTROLLER) == [
        *("configure", "activate"),
        *("deactivate", "cleanup", "shutdown"),
    ]


def test_a_node_that_stops_reporting_breaks_its_rates() -> None:
    world = World(plan=PROMISED, strict_rates=True, later=seconds(KEPT, *[None] * 6))
    ended = world.run(duration_s=6)
    assert ended.exit_code == 1
    assert ended.cause.startswith("/obelisk_control_0: timer was not reported for 3.")


def test_one_late_report_breaks_nothing() -> None:
    world = World(plan=PROMISED, strict_rates=True, later=seconds(KEPT, None, KEPT, None, KEPT))
    assert world.run(duration_s=5).exit_code == 0


def with_topic(topic: str | None) -> Plan:
    return replace(
        PROMISED,
        nodes=tuple(
            replace(p, rates=tuple(replace(one, topic=topic) for one in p.rates))
            for p in PROMISED.nodes
        ),
    )


def external(hz: float) -> RatesReported:
    return replace(rates(CONTROLLER, hz, "broken" if hz < 90 else "kept"), is_external=True)


def unreported(world: World) -> list[RatesUnreported]:
    return [event for event in world.published if isinstance(event, RatesUnreported)]


@pytest.mark.parametrize("strict", [False, True])
def test_a_rate_that_is_never_reported_and_that_no_topic_shows_is_unknown(strict: bool) -> None:
    world = World(plan=PROMISED, strict_rates=strict)
    assert world.run(duration_s=9).exit_code == int(strict)
    (event,) = unreported(world)
    assert (event.node, event.measured, event.unknown) == (CONTROLLER, (), ("timer",))


def test_a_rate_that_is_never_reported_is_measured_on_its_topic() -> None:
    later = seconds(None, None, None, None, external(100), external(100), external(50))
    world = World(plan=with_topic("/ctrl"), strict_rates=True, later=later)
    assert world.run(duration_s=9).exit_code == 1
    (event,) = unreported(world)
    assert (event.measured, event.unknown) == (("timer",), ())
    assert [type(event) for event in reported_of_rates(world)] == [RateBroken]


def test_a_node_with_diagnostics_and_no_rates_expects_none() -> None:
    world = World(plan=PROMISED, strict_rates=True, diagnostics=frozenset({CONTROLLER}))
    assert world.run(duration_s=9).exit_code == 0
    assert unreported(world) == []


def test_a_node_that_reports_late_is_not_measured_from_outside() -> None:
    later = seconds(None, None, None, None, KEPT, external(50), KEPT)
    world = World(plan=with_topic("/ctrl"), strict_rates=True, later=later)
    assert world.run(duration_s=7).exit_code == 0


def test_a_topic_without_messages_has_no_rate() -> None:
    silent = TopicRate(count=9, lost=0, seen=5, window_s=2.0, rate_hz=100.0, age_s=4.0)
    rate = external_rate(PERIOD, silent)
    assert (rate.standing, rate.measured_hz) == ("broken", 0.25)
    assert external_rate(PERIOD, replace(silent, age_s=0.01)).standing == "kept"


def test_a_node_that_reports_again_after_a_silence_is_reported() -> None:
    world = World(plan=PROMISED, later=seconds(KEPT, *[None] * 5, KEPT))
    world.run(duration_s=7)
    assert [type(event) for event in reported_of_rates(world)] == [RateBroken, RateKept]


def test_a_fault_is_reported_after_a_reported_silence() -> None:
    world = World(plan=PROMISED, later=seconds(KEPT, KEPT, *[None] * 5, BROKEN, BROKEN))
    world.run(duration_s=9)
    silent, measured = reported_of_rates(world)
    assert isinstance(silent, RateBroken)
    assert silent.silent_s == pytest.approx(3.0)
    assert isinstance(measured, RateBroken)
    assert (measured.rate.measured_hz, measured.silent_s) == (50, 0)


def test_a_rate_that_is_known_to_be_broken_is_not_reported_once_more_after_a_silence() -> None:
    world = World(plan=PROMISED, later=seconds(BROKEN, *[None] * 5, BROKEN))
    world.run(duration_s=7)
    assert [type(event) for event in reported_of_rates(world)] == [RateBroken, RateMoved, RateMoved]


def test_an_inactive_node_has_no_expected_rates() -> None:
    inactive = StateSeen(node=CONTROLLER, state="inactive", transition="deactivate")
    world = World(plan=PROMISED, strict_rates=True, later=seconds(KEPT))
    world.later += [inactive, BROKEN, *[1.0] * 6]
    assert world.run(duration_s=6).exit_code == 0
    assert reported_of_rates(world) == []


def test_during_shutdown_no_rates_are_expected() -> None:
    world = World(plan=PROMISED, strict_rates=True, later=seconds(KEPT))
    world.later += [lambda: world.inbox.extend([StopRequested(reason="enough"), BROKEN])]
    assert world.run(duration_s=None).exit_code == 0
    assert reported_of_rates(world) == []


def test_a_crashed_node_has_no_broken_rate() -> None:
    world = World(plan=PROMISED, strict_rates=True, on_crash="ignore", later=seconds(KEPT))
    world.later += [ProcessEnded(process=CONTROLLER, code=1), *[1.0] * 6]
    assert world.run(duration_s=6).exit_code == 0


def test_a_node_that_hangs_is_left_to_the_watch_over_hangs() -> None:
    world = World(plan=PROMISED, strict_rates=True, on_crash="ignore", later=seconds(KEPT))
    world.later += [lambda: world.mute.add(CONTROLLER), *[1.0] * 8]
    assert world.run(duration_s=8).exit_code == 0
    assert reported_of_rates(world) == []


def test_nodes_of_other_stacks_and_devices_are_ignored() -> None:
    other = rates("/other", 10, "broken")
    world = World(plan=PROMISED, strict_rates=True, later=seconds(other, other))
    assert world.run(duration_s=2).exit_code == 0
    assert reported_of_rates(world) == []


def test_a_rate_without_a_location_in_the_config_is_reported_without() -> None:
    broken = rates(ESTIMATOR, 50, "broken")
    world = World(plan=PROMISED, strict_rates=True, later=seconds(broken))
    ended = world.run(duration_s=5)
    assert ended.cause.endswith("(p99 latency 2.5 ms)")
    assert ended.origin == "c.yaml:1:1"


def test_the_status_contains_the_rates_of_active_nodes() -> None:
    answers: list[StackStatus] = []
    world = World(plan=PROMISED, later=seconds(KEPT, OFF))
    world.later += [StatusRequested(reply=answers.append)]
    world.later += [StateSeen(node=CONTROLLER, state="inactive", transition="deactivate")]
    world.later += [StatusRequested(reply=answers.append)]
    world.run(duration_s=5)
    rates_of = [{n.node: n.rates for n in answer.nodes}[CONTROLLER] for answer in answers]
    assert rates_of == [OFF.rates, ()]


def test_a_video_that_a_robot_reports_is_an_event_of_the_run() -> None:
    video = VideoReported(node=ROBOT, video=VideoStatus(state="recording", path="/here/out.mp4"))
    world = World(later=deque([video, 1.0]))
    assert world.run(duration_s=1).exit_code == 0
    assert video in world.published
