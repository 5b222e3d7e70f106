"""Every cell of the conformance table has a test or a reason."""

import importlib.machinery
import importlib.util
import subprocess
import sys

from support.program import ROOT

# A script without the ending .py, which `import` does not find.
LOADER = importlib.machinery.SourceFileLoader("conformance", str(ROOT / "tests/conformance"))
conformance = importlib.util.module_from_spec(importlib.util.spec_from_loader("conformance", LOADER))
LOADER.exec_module(conformance)


def test_every_cell_has_a_test_or_a_reason():
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", ROOT / "tests/rclpy"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    tested = {cell for line in listed if (cell := conformance.cell_of(line))}
    cells = {(row, column) for row in conformance.rows() for column in conformance.COLUMNS}
    assert not [cell for cell in cells if cell not in tested and not conformance.why_empty(*cell)]
    assert tested <= cells, "a test is for no row of the table"


def test_a_failed_test_shows_in_its_cell(tmp_path):
    path = tmp_path / "results.xml"
    path.write_text(
        '<testsuites><testsuite><testcase name="test_bag[/dlo/mask]"/><testcase name="test_bag[/dlo/keypoints]"><failure/></testcase>'
        "</testsuite></testsuites>"
    )
    lines, holds = conformance.table(conformance.results(path))
    line = {words[0]: words[1:] for words in map(str.split, lines)}
    assert not holds and line["/dlo/mask"][-2:] == ["1", "hold"] and line["/dlo/keypoints"][-1] == "FAILS"
