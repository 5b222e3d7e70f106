"""What the documents of the repository refer to: links, anchors, paths and options of scripts.

A *document* is a Markdown file. A *path* is a word of a code span or of a shell block that names a file or folder of the repository.
"""

import itertools
import pathlib
import re
import shlex
import subprocess
from dataclasses import dataclass, field

ROOT = pathlib.Path(__file__).resolve().parents[2]
# Folders with which a path from the root of the repository begins.
FOLDERS = ("nodes/", "tests/", "msgs/", "launch_configs/", "bags/", ".github/", ".ci/")
# Made by builds, tests and the demo: .gitignore names them.
MADE = {"target", ".venv", ".build", "out", "demo"}
# Options after which a document names what a command writes.
OUTPUT = re.compile(r"(?:--out|--prefix|-o)[ =]([\w.-]+)")
WITH_EXTENSION = re.compile(r"/[\w.-]*\w\.[a-z][a-z0-9]{0,11}(\.gz)?$")
PLACEHOLDER = re.compile(r"[<>{}*$]|\.\.\.")
UPPER_CASE = re.compile(r"^[A-Z][A-Z0-9_]*(\.\w+)?$")
SHELL = {"", "sh", "bash", "console"}


@dataclass
class Text:
    """Parts of a document, each with its line number."""

    prose: list = field(default_factory=list)
    shell: list = field(default_factory=list)

    def spans(self):
        """Code spans of the prose, also those that are broken over two lines: line number and text."""
        for number, paragraph in paragraphs(self.prose):
            for match in re.finditer(r"(`+)(.+?)\1(?!`)", paragraph, re.S):
                yield number + paragraph[: match.start()].count("\n"), match[2].replace("\n", " ")


def paragraphs(lines):
    """Paragraphs of numbered lines: number of the first line, and text."""
    first, kept = None, []
    for number, line in [*lines, (0, "")]:
        if line.strip():
            first = first or number
            kept.append(line)
        elif kept:
            yield first, "\n".join(kept)
            first, kept = None, []


def parts(text):
    """Prose and shell blocks of a document. Blocks in other languages are left out."""
    found, fence, blank = Text(), None, True
    for number, line in enumerate(text.splitlines(), 1):
        mark = re.match(r"\s*(```+|~~~+)\s*([\w-]*)", line)
        if mark:
            fence = None if fence is not None else mark[2]
            found.prose.append((number, ""))
        elif fence is not None:
            if fence in SHELL:
                found.shell.append((number, line))
            found.prose.append((number, ""))
        elif line.startswith("    ") and (blank or (found.shell and found.shell[-1][0] == number - 1)):
            found.shell.append((number, line))
            found.prose.append((number, ""))
        else:
            found.prose.append((number, line))
        blank = not line.strip()
    return found


def anchors(text):
    """Anchors of the headings of a document, by GitHub's rules: lower case, no punctuation, a number after a repeated one."""
    found = set(re.findall(r'<a (?:id|name)="([^"]+)"', text))
    for _, line in parts(text).prose:
        if heading := re.match(r"#{1,6}\s+(.*?)\s*#*$", line):
            plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading[1])
            slug = re.sub(r"[^\w\- ]", "", plain.lower()).replace(" ", "-")
            repeated = (f"{slug}-{n}" for n in range(1, len(found) + 1))
            found.add(next(name for name in (slug, *repeated) if name not in found) if slug in found else slug)
    return found


class Repository:
    """Files of a repository, and the check of its documents."""

    def __init__(self, root=ROOT, files=None):
        self.root = root
        if files is None:
            # Files that are not committed yet count, too; those that git ignores do not.
            listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
            output = subprocess.run(listed, cwd=root, capture_output=True, text=True, check=True).stdout
            files = [name for name in output.split("\0") if name and (root / name).exists()]
        self.files = sorted(set(files))
        self.places = set(self.files).union(*({str(p) for p in pathlib.PurePosixPath(f).parents} for f in self.files))
        # Packages of the workspace and of its dependencies, whose own tests a document of a patch names.
        locks = (name for name in self.files if pathlib.PurePosixPath(name).name == "Cargo.lock")
        self.packages = {name for lock in locks for name in re.findall(r'^name = "([\w-]+)"', self.text(lock), re.M)}

    def text(self, name):
        """Text of a file."""
        return (self.root / name).read_text(encoding="utf-8")

    def documents(self):
        """Names of all documents."""
        return [name for name in self.files if name.endswith(".md")]

    def faults(self, document):
        """Faults of a document, as lines of text with its name and line number."""
        text = self.text(document)
        found = parts(text)
        outputs = set(OUTPUT.findall(text))
        faults = self._links(document, found)
        for number, span in found.spans():
            faults += self._paths(document, number, words(span), outputs)
            faults += self._commands(number, words(span))
        for number, line in joined(found.shell):
            # In a block, only paths from the root count: others are relative to the place where the reader works.
            named = [word for word in words(line) if word.startswith(FOLDERS)]
            faults += self._paths(document, number, named, outputs)
            faults += self._commands(number, words(line))
        return [f"{document}:{number}: {fault}" for number, fault in faults]

    def _links(self, document, found):
        faults = []
        for first, paragraph in paragraphs(found.prose):
            # Code spans hold no links; as many characters stay, so that the line can be counted.
            plain = re.sub(r"(`+).+?\1(?!`)", lambda m: re.sub(r"[^\n]", "x", m[0]), paragraph, flags=re.S)
            targets = [*re.finditer(r"\]\(\s*<?([^)\s>]+)>?[^)]*\)", plain), *re.finditer(r"^\[[^\]]+\]:\s*(\S+)", plain, re.M)]
            for match in targets:
                number = first + plain[: match.start(1)].count("\n")
                if fault := self._link(document, match[1]):
                    faults.append((number, fault))
        return faults

    def _link(self, document, target):
        if re.match(r"[a-z][a-z+.-]*:", target):
            return None
        path, _, anchor = target.partition("#")
        place = normal(pathlib.PurePosixPath(document).parent / path) if path else document
        if place not in self.places:
            return f"link to {target}: there is no {place}"
        if anchor and anchor not in (anchors(self.text(place)) if place.endswith(".md") else ()):
            return f"link to {target}: {place} has no heading for #{anchor}"
        return None

    def _paths(self, document, number, candidates, outputs):
        return [(number, f"{word}: no such path") for word in candidates if is_path(word) and not self._knows(document, word, outputs)]

    def _knows(self, document, word, outputs):
        """Tells whether a path exists, is a placeholder or is made at run time.

        A path counts from the root, or is the end of a path below the document's folder (`src/node.rs` of a crate, or of each crate).
        """
        folder = str(pathlib.PurePosixPath(document).parent)
        below = "" if folder in (".", ".github") else f"{folder}/"
        # Outside a crate, `tests/` and `nodes/` are those of the root.
        may_be_an_end = re.match(r"nodes/\w", folder) or not word.startswith(FOLDERS)
        word = word.rstrip("/")
        if word in self.places or (may_be_an_end and any(p.startswith(below) and p.endswith(f"/{word}") for p in self.places)):
            return True
        components = word.split("/")
        if components[0] in MADE | outputs or PLACEHOLDER.search(word):
            return True
        # An upper-case name is a placeholder, unless it may be a document, whose names are upper-case, too.
        known = (n for n in range(len(components)) if "/".join(components[: n + 1]) not in self.places)
        return any(UPPER_CASE.match(components[n]) and not components[n].endswith((".md", ".cff")) for n in known)

    def _commands(self, number, given):
        """Faults of packages and examples after cargo, of options after a script, and of arguments after a launch file."""
        faults = []
        if given[:1] == ["cargo"]:
            own = given[: given.index("--")] if "--" in given else given
            for option, name in itertools.pairwise(own):
                if option in ("-p", "--package") and name not in self.packages and not UPPER_CASE.match(name):
                    faults.append((number, f"cargo {option} {name}: no such package"))
                is_example = any(f.endswith((f"/examples/{name}.rs", f"/examples/{name}/main.rs")) for f in self.files)
                if option == "--example" and not is_example:
                    faults.append((number, f"cargo --example {name}: no such example"))
        script = next((n for n, word in enumerate(given) if word in self.places and self._is_script(word)), None)
        if script is not None:
            folder = str(pathlib.PurePosixPath(given[script]).parent)
            # A script that only starts another one passes its options on.
            sources = "".join(self.text(f) for f in self.files if str(pathlib.PurePosixPath(f).parent) == folder and self._is_script(f))
            for option in (word.partition("=")[0] for word in given[script + 1 :] if word.startswith("--")):
                if f'"{option}"' not in sources and f" {option}" not in sources:
                    faults.append((number, f"{given[script]} {option}: no script in {folder} knows the option"))
        launched = next((word for word in given if word.endswith(".launch.xml") and word in self.places), None)
        if launched:
            for name in (word.partition(":=")[0] for word in given if ":=" in word):
                if f'<arg name="{name}"' not in self.text(launched):
                    faults.append((number, f"{launched} {name}:=: the file has no such argument"))
        return faults

    def _is_script(self, name):
        # Benches and tests only: the options of the program are checked by a test of Rust.
        is_text = name in self.files and name.startswith("tests/") and pathlib.PurePosixPath(name).suffix in ("", ".py")
        return is_text and (name.endswith(".py") or self.text(name).startswith("#!"))

    def sources(self):
        """Names of the files of source: Rust and Python, also scripts of Python without an ending."""
        for name in self.files:
            suffix = pathlib.PurePosixPath(name).suffix
            if suffix in (".rs", ".py") or (suffix == "" and self._is_script(name) and "python" in self.text(name).partition("\n")[0]):
                yield name


def normal(path):
    """Path from the root without `..`, as text; a path that leaves the root keeps a leading `..`."""
    kept = []
    for part in path.parts:
        if part == ".." and kept and kept[-1] != "..":
            kept.pop()
        elif part != ".":
            kept.append(part)
    return "/".join(kept) or "."


def joined(lines):
    """Numbered lines of shell, with continuations joined and comments cut off."""
    kept, first = "", None
    for number, line in lines:
        first = first or number
        kept += line.removesuffix("\\")
        if not line.endswith("\\"):
            yield first, re.split(r"\s# |\s{2,}#", kept)[0]
            kept, first = "", None


def words(command):
    """Words of a shell command, without the name of an option that is joined to its value."""
    try:
        split = shlex.split(command)
    except ValueError:
        split = command.split()
    return [re.sub(r"^--[\w-]+=(?=.*/)", "", word).rstrip(",;:") for word in split]


def is_path(word):
    """Tells whether a word claims to be a path of the repository.

    A leading slash marks a topic or an absolute path, a tilde the user's folder, and a colon an address or an argument.
    """
    if word.startswith(("/", "~", "-", "http")) or ":" in word or "(" in word:
        return False
    return word.startswith(FOLDERS) or bool(WITH_EXTENSION.search(word))
