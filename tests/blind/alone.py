"""Lock of a folder: two programs in one folder would write the same worlds, and break each other's seals."""

import fcntl
import sys


def alone(folder):
    """Creates and locks the folder until the program ends or the returned file is closed; exits if another program holds the lock."""
    folder.mkdir(parents=True, exist_ok=True)
    file = (folder / "lock").open("w")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        sys.exit(f"{folder}: expected to be alone there, but another program draws or searches in it")
    return file
