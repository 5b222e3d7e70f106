"""Stamps of messages as numbers."""

import numpy

# Bytes of a serialised message before its header: the encapsulation of CDR.
CDR_HEADER = 4


def stamp_s(stamp):
    """A builtin_interfaces/Time in s."""
    return stamp.sec + 1e-9 * stamp.nanosec


def stamp_ns(stamp):
    """A builtin_interfaces/Time in ns."""
    return stamp.sec * 10**9 + stamp.nanosec


def stamp_of_bytes_ns(data):
    """Stamp in ns of a serialised message that begins with a header."""
    sec, nanosec = numpy.frombuffer(data[CDR_HEADER : CDR_HEADER + 8], numpy.uint32)
    return int(sec) * 10**9 + int(nanosec)
