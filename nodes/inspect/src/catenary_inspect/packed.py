"""What rosbag2 compresses beyond the chunks of MCAP: whole files, and messages one by one, by zstd."""

import zstandard

from .definitions import Undecodable

MAGIC = b"\x28\xb5\x2f\xfd"


def is_packed(data):
    """Whether these bytes begin as a frame of zstd does; a message in CDR begins with a zero."""
    return bytes(data[:4]) == MAGIC


def unpack(data):
    try:
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except zstandard.ZstdError as error:
        raise Undecodable(f"its compression is damaged: {error}") from error


def unpack_file(path, unpacked):
    """Writes what can be had of a compressed file to another, and returns notes of what cannot."""
    with open(path, "rb") as source, open(unpacked, "wb") as target:
        try:
            zstandard.ZstdDecompressor().copy_stream(source, target)
        except zstandard.ZstdError as error:
            return [f"{path}: damaged: {error}"]
    return []
