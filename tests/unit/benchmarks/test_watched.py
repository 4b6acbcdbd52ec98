"""What is made of the rates of a stack that is watched and of one that is not."""

from benchmarks.watched import watched_to_alone


def test_each_round_of_the_watched_stack_is_held_against_the_one_alone() -> None:
    def run(*kept: float) -> dict[str, dict[str, float]]:
        return {"kept": {f"/node timer_{place}": share for place, share in enumerate(kept)}}

    runs = {
        "separate, alone": [run(1.0, 0.8), run(1.0, 0.5), run(1.0, 1.0)],
        "separate, watched": [run(0.4, 1.0), run(0.5, 1.0), run(1.0, 0.9)],
    }
    assert watched_to_alone(runs, "separate") == 0.9
