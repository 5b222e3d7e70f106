"""Waiting for a condition with a deadline."""

import time


def wait_for(condition, seconds, what, pause=lambda: time.sleep(0.05)):
    """Returns the first true value of `condition`; fails with `what` after `seconds`."""
    deadline = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < deadline, f"not within {seconds} s: {what}"
        pause()
    return value
