"""Bag files of a few kilobytes that unpack to gigabytes: one line with file, size and limit, and nothing on the disk afterwards."""

import pathlib
import signal
import struct
import time

import pytest

from support.waiting import wait_for

INTERRUPTED = 130
BLOCK = 128 << 10


def zeros(size, is_stated):
    """A zstd frame of zeros, 4 bytes for each block of 128 KiB, that states its size or not."""
    blocks = (size + BLOCK - 1) // BLOCK
    head = bytes([0xC0 if is_stated else 0, 7 << 3]) + (struct.pack("<Q", size) if is_stated else b"")
    block = lambda i: struct.pack("<I", min(BLOCK, size - i * BLOCK) << 3 | 2 | (i == blocks - 1))[:3] + b"\0"
    return b"\x28\xb5\x2f\xfd" + head + b"".join(map(block, range(blocks)))


@pytest.fixture
def scratch(tmp_path):
    """An empty folder for scratch files."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    return folder


@pytest.mark.parametrize("is_stated", [True, False], ids=["stated", "hidden"])
def test_a_file_that_unpacks_to_more_than_its_limit_is_refused(program, tmp_path, scratch, is_stated):
    bomb = tmp_path / "bomb.mcap.zstd"
    bomb.write_bytes(zeros(8 << 30, is_stated))
    for command in (("info",), ("reindex",), ("replay",)):
        done = program(*command, bomb, folder=tmp_path, TMPDIR=scratch)
        (line,) = done.stderr.splitlines()
        got = "8589934592" if is_stated else "more"
        assert done.returncode in (1, 2) and "bomb.mcap.zstd: expected at most" in line and f"got {got}" in line, done
        assert not list(scratch.iterdir())
        # A file without a stated size writes up to the limit: once is enough.
        if not is_stated:
            break


def test_an_interrupt_while_a_file_is_unpacked_leaves_nothing(program, tmp_path, scratch):
    bomb = tmp_path / "bomb.mcap.zstd"
    bomb.write_bytes(zeros(1 << 30, False) * 3)
    child = program.start("info", bomb, folder=tmp_path, TMPDIR=scratch)
    try:
        wait_for(lambda: unpacks(child), 60, "a scratch file", pause=lambda: time.sleep(0.002))
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=60)
    finally:
        child.kill()
        child.wait()
    assert child.returncode == INTERRUPTED and out == "" and "interrupted" in err, (child.returncode, out, err)
    assert len(err.splitlines()) == 1 and not list(scratch.iterdir())


def unpacks(child):
    """Tells whether a process holds a file without a name in the folder of the test."""
    assert child.poll() is None, child.communicate()
    names = []
    for entry in pathlib.Path(f"/proc/{child.pid}/fd").iterdir():
        try:
            names.append(str(entry.readlink()))
        except OSError:
            continue
    return any(name.endswith(" (deleted)") and "scratch" in name for name in names)
