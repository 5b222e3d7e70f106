"""Reliable topics beside a recorder, and deaths in an episode, in short; tests/bench/endurance is the long form."""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "bench/endurance"))
import kills  # noqa: E402
import steady  # noqa: E402


def quiet(line):
    pass


def test_no_message_of_a_reliable_topic_is_lost_to_rclpy_or_to_the_bag(session):
    found = steady.run(session, 0.15, False, quiet)
    assert found["episodes"] >= 1 and not found["failures"], found["failures"]
    for name, row in found["messages"].items():
        assert row["sent"] > 0 and steady.no_loss(row), (name, row)


def test_an_episode_fails_safe_and_the_next_one_runs_where_runner_or_cell_are_killed(session):
    for row in kills.run(session, (kills.RUNNER, kills.CELL), quiet):
        assert [what for what, holds in kills.verdicts([row]) if not holds] == [], row
