"""Reliable topics beside a recorder, and killed nodes during an episode, at a small size; tests/bench/endurance is the bench."""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "bench/endurance"))
import kills
import steady


def test_no_message_of_a_reliable_topic_is_lost_to_rclpy_or_to_the_bag(session):
    # In minutes: one whole episode and part of another.
    found = steady.run(session, 0.15, False, lambda line: None)
    assert found["episodes"] >= 1 and not found["failures"], found["failures"]
    for name, row in found["messages"].items():
        assert row["sent"] > 0 and steady.no_loss(row), (name, row)


def test_an_episode_fails_safe_and_the_next_one_runs_after_a_kill_of_runner_or_cell(session):
    for row in kills.run(session, (kills.RUNNER, kills.CELL), lambda line: None):
        assert [what for what, holds in kills.verdicts([row]) if not holds] == [], row
