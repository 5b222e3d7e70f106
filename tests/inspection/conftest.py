"""Fixtures that run catenary-inspect in this process."""

import json

import pytest
from catenary_inspect.main import main


@pytest.fixture
def figures(capsys):
    """Runs a command with --json, which has to succeed; returns the document."""

    def run(*arguments):
        assert main([*map(str, arguments), "--json"]) == 0, capsys.readouterr().err
        return json.loads(capsys.readouterr().out)

    return run


@pytest.fixture
def refused(capsys):
    """Runs a command that has to end with one line on stderr that holds all of `says`."""

    def run(*arguments, says):
        assert main(list(map(str, arguments))) == 1
        said = capsys.readouterr()
        assert said.out == "" and said.err.startswith("catenary-inspect: ") and said.err.count("\n") == 1
        for part in says:
            assert part in said.err, said.err

    return run
