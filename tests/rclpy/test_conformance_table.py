"""No cell of the conformance table is without a test or a reason."""

import importlib.machinery
import importlib.util
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
LOADER = importlib.machinery.SourceFileLoader("conformance", str(HERE.parent / "conformance"))
conformance = importlib.util.module_from_spec(importlib.util.spec_from_loader("conformance", LOADER))
LOADER.exec_module(conformance)


def test_every_cell_has_a_test_or_a_reason():
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", HERE]
    listed = subprocess.run(command, cwd=HERE.parents[1], capture_output=True, text=True, check=True).stdout.splitlines()
    tested = {cell for line in listed if (cell := conformance.cell_of(line))}
    cells = {(row, column) for row in conformance.rows() for column in conformance.COLUMNS}
    assert not [cell for cell in cells if cell not in tested and not conformance.why_empty(*cell)]
    assert tested <= cells, "a test is for no row of the table"


def test_a_failed_test_shows(tmp_path):
    path = tmp_path / "results.xml"
    path.write_text(
        '<testsuites><testsuite><testcase name="test_bag[/dlo/mask]"/><testcase name="test_bag[/dlo/keypoints]"><failure/></testcase>'
        "</testsuite></testsuites>"
    )
    lines, holds = conformance.table(conformance.results(path))
    line = {words[0]: words[1:] for words in map(str.split, lines)}
    assert not holds and line["/dlo/mask"][-2:] == ["1", "hold"] and line["/dlo/keypoints"][-1] == "FAILS"
