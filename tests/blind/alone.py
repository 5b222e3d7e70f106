"""One program at a time works in a folder: two would write the same worlds and answers, and the seals of one would be broken by the other."""

import fcntl
import sys


def alone(folder):
    """Holds the folder, which is made if need be, until the program ends or the returned file is closed; exits where another program holds it."""
    folder.mkdir(parents=True, exist_ok=True)
    file = (folder / "lock").open("w")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        sys.exit(f"{folder}: expected to be alone there, but another program draws or searches in it")
    return file
