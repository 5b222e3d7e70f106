"""Documents refer to what is there: links, anchors, paths, options of scripts, versions; and files of source keep their promised size.

The commands of `catenary` itself are checked by nodes/catenary/tests/readme_commands.rs. Needs git, and neither the program nor ROS.
"""

import re

import pytest

from support.documents import Repository

# .github/CONTRIBUTING.md promises it.
LONGEST_SOURCE_LINES = 600
LIBRARY_LINES = 100
# `lib.rs` of the crates that are no node: one is the whole library, the other has the traits of the generated types.
OTHER_LIBRARIES = ("nodes/arm/panda_model_library/src/lib.rs", "msgs/src/lib.rs")


@pytest.fixture(scope="module")
def repository():
    return Repository()


def test_every_reference_of_a_document_exists(repository):
    documents = repository.documents()
    assert len(documents) > 30, f"found {documents}: the search is broken"
    faults = [fault for document in documents for fault in repository.faults(document)]
    assert not faults, "\n".join(faults)


def test_files_of_source_are_short(repository):
    lines = {name: repository.text(name).count("\n") for name in repository.sources()}
    assert len(lines) > 300, f"found {len(lines)} files: the search is broken"
    long = {name: count for name, count in lines.items() if count >= LONGEST_SOURCE_LINES}
    assert not long, f"{LONGEST_SOURCE_LINES} lines and more: {long}"
    libraries = {name: n for name, n in lines.items() if name.endswith("/src/lib.rs") and name not in OTHER_LIBRARIES}
    long = {name: count for name, count in libraries.items() if count >= LIBRARY_LINES}
    assert not long, f"{LIBRARY_LINES} lines and more: {long}"


def test_one_version_stands_everywhere(repository):
    patterns = {
        "Cargo.toml": r'^version = "(.+)"',
        "msgs/package.xml": r"<version>(.+)</version>",
        "nodes/package.xml": r"<version>(.+)</version>",
        "nodes/inspect/pyproject.toml": r'^version = "(.+)"',
        ".github/CITATION.cff": r"^version: (.+)$",
    }
    versions = {name: re.search(pattern, repository.text(name), re.M)[1] for name, pattern in patterns.items()}
    assert len(set(versions.values())) == 1, versions


MADE_UP = {
    "README.md": "# Top\n\n## Two words, really\n\n## Two words, really\n",
    "Cargo.lock": '[[package]]\nname = "bent"\n',
    "nodes/bent/src/node.rs": "",
    "nodes/bent/src/inner/law.rs": "",
    "nodes/bent/examples/echo.rs": "",
    "tests/run": "#!/usr/bin/env bash\nexec python tests/work.py\n",
    "tests/work.py": 'parser.add_argument("--out")\n',
    "launch_configs/sim.launch.xml": '<launch><arg name="model"/></launch>\n',
}


@pytest.fixture
def faults(tmp_path):
    """Faults of a made-up document in a made-up repository: the text behind the line number, line by line."""
    for name, text in MADE_UP.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)

    def check(text, document="nodes/bent/README.md"):
        (tmp_path / document).write_text(text)
        return [fault.removeprefix(f"{document}:") for fault in Repository(tmp_path, [*MADE_UP, document]).faults(document)]

    return check


@pytest.mark.parametrize(
    "text",
    [
        "[top](../../README.md#two-words-really), [its twin](../../README.md#two-words-really-1), [other](https://example.org/none)",
        "# Own\n\n[here](#own) and [a folder](src/)\n\n![picture][p]\n\n[p]: src/node.rs",
        "`nodes/bent/src/node.rs`, `src/node.rs`, `inner/law.rs`, `nodes/bent/`, `tests/run`",
        "`nodes/NAME/src/node.rs`, `OUT/state.json`, `nodes/*/README.md`, `nodes/<name>/x.rs`, `tests/{a,b}.py`, `out/page.html`",
        "`/camera/image.raw`, `~/.ros/log.txt`, `std_srvs/srv/SetBool`, `policy/action`, `exp(-cost / 2)`, `1/8`",
        "`catenary infer bag --out found` writes `found/verdict.json`.",
        "    cargo test -p bent && tests/run --out DIR   # nodes/none.rs\n\n`cargo run -p bent --example echo`",
        '```sh\ncatenary launch launch_configs/sim.launch.xml model:=M\n```\n\n```rust\nlet path = "nodes/none.rs";\n```',
        "`[no](link.md)` is code, and so is ``a ` [no](link.md)``.",
    ],
)
def test_right_references_are_accepted(faults, text):
    assert faults(text) == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a\n\n[b](none.md)", "3: link to none.md: there is no nodes/bent/none.md"),
        ("[b](../../../etc/README.md)", "1: link to ../../../etc/README.md: there is no ../etc/README.md"),
        ("[b](../../README.md#three)", "1: link to ../../README.md#three: README.md has no heading for #three"),
        ("[b](#own)", "1: link to #own: nodes/bent/README.md has no heading for #own"),
        ("[b]: src/none.rs", "1: link to src/none.rs: there is no nodes/bent/src/none.rs"),
        ("a\nb `nodes/bent/src/nodes.rs`", "2: nodes/bent/src/nodes.rs: no such path"),
        ("`nodes/brent/`", "1: nodes/brent/: no such path"),
        ("`outer/law.rs`", "1: outer/law.rs: no such path"),
        ("`tests/REDME.md`", "1: tests/REDME.md: no such path"),
        ("`tests/run\nnodes/none.rs`", "1: nodes/none.rs: no such path"),
        ("```sh\npython tests/none.py\n```", "2: tests/none.py: no such path"),
        ("a\n\n    tests/run --uot DIR", "3: tests/run --uot: no script in tests knows the option"),
        ("`cargo test -p brent`", "1: cargo -p brent: no such package"),
        ("`cargo run -p bent --example eco`", "1: cargo --example eco: no such example"),
        (
            "`catenary launch launch_configs/sim.launch.xml modle:=M`",
            "1: launch_configs/sim.launch.xml modle:=: the file has no such argument",
        ),
    ],
)
def test_a_wrong_reference_is_named_with_its_line(faults, text, expected):
    assert faults(text) == [expected]


def test_outside_a_crate_a_path_of_the_tests_counts_from_the_root(faults):
    assert faults("`src/node.rs`, `inner/law.rs`", document="nodes/README.md") == []
    assert faults("`tests/work.py`", document="tests/README.md") == []
    assert faults("`nodes/src/node.rs`", document="nodes/README.md") == ["1: nodes/src/node.rs: no such path"]
