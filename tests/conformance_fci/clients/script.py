"""Shared part of the clients: one check is one function of the script, called with the address of the server."""

import sys
import time


def server(instruction):
    """Has the server do something; returns its answer."""
    print("server", instruction, flush=True)
    return sys.stdin.readline().strip()


def wait_until(what, holds, seconds=20):
    """Waits until a condition holds."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, f"{what} did not come"


def failure(action):
    """Message of the exception with which an action ends."""
    try:
        action()
    except Exception as error:
        return str(error)
    raise AssertionError("expected an error, and there was none")


def smooth(s):
    """Profile from 0 to 1 whose first two derivatives vanish at both ends."""
    return s**3 * (10 - 15 * s + 6 * s * s)


def farthest(a, b):
    """Largest difference of two lists."""
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def main(functions):
    """Runs the check that the command line names, and prints its row."""
    name, address = sys.argv[1:3]
    print(functions[name](address), flush=True)
