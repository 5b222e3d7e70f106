"""The program under test, run to its end or beside a test.

CATENARY_PROGRAM: path of the program; target/release/catenary by default.
"""

import json
import os
import pathlib
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = pathlib.Path(os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary"))
MODELS = ROOT / "launch_configs/models"
MODEL = MODELS / "soft_bar.yaml"
BAG = ROOT / "bags/swing"


def completed(arguments, environment, folder, seconds):
    """Runs the program to its end; returns a CompletedProcess with exit code, stdout and stderr."""
    command = [PROGRAM, *map(str, arguments)]
    return subprocess.run(
        command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=seconds, check=False
    )


class Program:
    """The program in a DDS domain of its own. A call runs it to its end, `start` runs it beside the test.

    Options of all methods: `folder`, the working directory; variables of the environment as keywords, None to leave one out.
    """

    def __init__(self, domain):
        self.domain = domain

    def environment(self, **changes):
        """Variables of the environment at this moment, with the program's domain and these changes."""
        own = {"ROS_DOMAIN_ID": str(self.domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        return {name: value for name, value in (os.environ | own | changes).items() if value is not None}

    def __call__(self, *arguments, folder=None, seconds=120, **environment):
        """Runs the program to its end within `seconds`; returns a CompletedProcess with exit code, stdout and stderr."""
        return completed(arguments, self.environment(**environment), folder, seconds)

    def text(self, *arguments, **options):
        """Stdout of a run that has to end with exit code 0."""
        done = self(*arguments, **options)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def json(self, *arguments, **options):
        """Document that `--json` prints in a run that has to end with exit code 0."""
        return json.loads(self.text(*arguments, "--json", **options))

    def start(self, *arguments, folder=None, **environment):
        """Starts the program; returns its process with pipes for stdout and stderr."""
        command, pipe = [PROGRAM, *map(str, arguments)], subprocess.PIPE
        own = self.environment(**environment)
        return subprocess.Popen(command, cwd=folder, env=own, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, text=True)
