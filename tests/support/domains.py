"""Unused DDS domains for tests, on this machine only.

A claim is an abstract socket, as `catenary demo` makes one. Each network namespace has its own, and it ends with the process.
"""

import os
import pathlib
import socket

# Every node that a test makes, in this process and in others, keeps to the loopback interface.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
# The deprecated variable would override the one above.
os.environ.pop("ROS_LOCALHOST_ONLY", None)

# Domain of the user, which tests leave alone.
USERS = os.environ.get("ROS_DOMAIN_ID", "0").strip() or "0"
# Discovery ports of these domains (7400 + 250 d and up) lie below the ephemeral ports of Linux, 32768 and up.
FIRST, LAST = 20, 70


def is_used(domain):
    """Tells whether a participant of this machine has a port of a domain (RTPS 2.5, section 9.6.2.3)."""
    tables = [pathlib.Path(path).read_text() for path in ("/proc/net/udp", "/proc/net/udp6")]
    rows = [row.split() for table in tables for row in table.splitlines()[1:]]
    return any((int(row[1].rsplit(":", 1)[1], 16) - 7400) // 250 == domain for row in rows)


class Domain:
    """A claimed domain that neither the user nor another test has, until it is given back."""

    def __init__(self):
        domains = range(FIRST, LAST + 1)
        start = os.getpid() % len(domains)
        for number in [*domains[start:], *domains[:start]]:
            if str(number) == USERS:
                continue
            self.claim = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                self.claim.bind(f"\0catenary/domain/{number}")
                if not is_used(number):
                    self.number = number
                    return
            except OSError:
                pass  # another process has claimed it
            self.claim.close()
        raise RuntimeError(f"expected a DDS domain of {FIRST} to {LAST} that nobody is in, found none")

    def give_back(self):
        self.claim.close()
