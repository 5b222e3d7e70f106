"""Files and single messages that rosbag2 compressed by zstd, beside the chunks of MCAP."""

import os

import zstandard

from .definitions import Undecodable

MAGIC = b"\x28\xb5\x2f\xfd"
# Limits of decompressed files and messages, those of `catenary info`: every file may have LEAST bytes, a larger one RATIO times its
# own, and an eighth of the disk stays free.
LEAST, RATIO, SPARED = 2 << 30, 200, 8
LARGEST_MESSAGE = 256 << 20


class TooLarge(Exception):
    """A file that unpacks to more than its limit; says both."""


def is_packed(data):
    """Tells whether bytes are a frame of zstd; a message in CDR begins with a zero instead."""
    return bytes(data[:4]) == MAGIC


def unpack(data):
    """Decompresses a message; raises Undecodable."""
    try:
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:
            message = reader.read(LARGEST_MESSAGE + 1)
    except zstandard.ZstdError as error:
        raise Undecodable(f"its compression is damaged: {error}") from error
    if len(message) > LARGEST_MESSAGE:
        raise Undecodable(f"expected at most {LARGEST_MESSAGE} bytes after decompression, got more")
    return message


def unpack_file(path, unpacked):
    """Decompresses a file into another as far as possible; returns notes on the rest. Raises TooLarge."""
    disk = os.statvfs(unpacked.parent)
    free = disk.f_bavail * disk.f_frsize
    limit = min(max(LEAST, RATIO * os.path.getsize(path)), free - free // SPARED)
    size = 0
    with open(path, "rb") as source, open(unpacked, "wb") as target:
        try:
            for block in zstandard.ZstdDecompressor().read_to_iter(source):
                size += len(block)
                if size > limit:
                    raise TooLarge(f"expected at most {limit} bytes after decompression, got more")
                target.write(block)
        except zstandard.ZstdError as error:
            return [f"{path}: damaged: {error}"]
    return []
