"""Words that the Markdown documents do not use, with the term of the field that stands in their place.

A reader of the field searches for its terms: a household word for one of them hides the text. The table holds only words whose every use
is wrong, so that plain English stays free. Code, in blocks with fences and in spans, is not read.
"""

import re
from fnmatch import fnmatch
from typing import NamedTuple

import pytest

from support.program import ROOT

FOLDERS = (".", ".github", "bags", "launch_configs", "msgs", "nodes", "tests")
ALL = "*"
READMES = "*README.md"


class Word(NamedTuple):
    """A word or phrase, the better term, and the paths of the documents that are read for it, as a pattern."""

    word: str
    term: str
    documents: str = ALL


# A word with a capital letter is found with this letter alone: it is wrong as the first word of a sentence.
WORDS = [
    Word("stated support", "prior support"),
    Word("the own", "matched (a policy), or the thing's name alone"),
    Word("an own", "separate, or hand-written"),
    Word("of our own", "written here"),
    Word("policy that is told", "oracle policy"),
    Word("policies that are told", "oracle policies"),
    Word("network that is told", "network that takes ... as input"),
    Word("told the object", "oracle"),
    Word("recording told", "posterior from the recording"),
    Word("every bar that is possible", "the whole prior"),
    Word("nobody tells", "not supervised"),
    Word("tells for each", "for each ..., reports"),
    Word("finds out about", "identifies"),
    Word("made good", "recovered"),
    Word("of one look", "of the same appearance"),
    Word("of the same look", "of the same appearance"),
    Word("surer", "more confident"),
    Word("hears none", "receives none"),
    Word("hears no target", "receives no target"),
    Word("unless it was asked", "unless you ask for it"),
    Word("given something wrong", "invalid input"),
    Word("in a bent way", "nonlinearly"),
    Word("to and fro", "back and forth"),
    Word("half of a file", "partial file"),
    Word("Else", "Otherwise"),
]


def documents():
    """Markdown files of the repository by their path, without those of builds and caches."""
    paths = {path for folder in FOLDERS for path in (ROOT / folder).glob("*.md" if folder == "." else "**/*.md")}
    names = {path.relative_to(ROOT).as_posix(): path for path in paths}
    return {name: names[name] for name in sorted(names) if not re.search(r"/\.", name)}


def without_code(text):
    """The text with blanks in place of code, on the same lines."""
    code = re.compile(r"^ *```.*?^ *```|`[^`]+`", re.DOTALL | re.MULTILINE)
    return code.sub(lambda match: re.sub(r"\S", " ", match[0]), text)


def faults(name, text, words=tuple(WORDS)):
    """A message for each use of a word in a document, which may be broken over two lines: document, line, word and better term."""
    prose = without_code(text)
    found = []
    for word in words:
        if not fnmatch(name, word.documents):
            continue
        phrase = r"\s+".join(map(re.escape, word.word.split()))
        case = 0 if word.word != word.word.lower() else re.IGNORECASE
        for match in re.finditer(rf"\b{phrase}\b", prose, case):
            line = prose.count("\n", 0, match.start()) + 1
            found.append((line, f"{name}:{line}: {word.word!r}: write {word.term!r}"))
    return [message for _, message in sorted(found)]


def test_no_document_uses_a_word_for_which_the_field_has_a_term():
    read = documents()
    assert {"README.md", ".github/CONTRIBUTING.md", "nodes/README.md", "nodes/catenary/README.md"} <= read.keys()
    found = [message for name, path in read.items() for message in faults(name, path.read_text())]
    assert not found, "\n" + "\n".join(found)


def test_every_pattern_of_the_table_names_documents():
    for word in WORDS:
        assert any(fnmatch(name, word.documents) for name in documents()), word


def test_a_fault_names_document_line_word_and_term():
    text = "# A policy\n\nThe own policy wins.\n"
    assert faults("made/up.md", text, [Word("the own", "matched")]) == ["made/up.md:3: 'the own': write 'matched'"]


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("Widths of the Stated\nsupport, and of the stated supporter.\n\nThe stated support.\n", [1, 4]),
        ("Code `the stated support` is free.\n\n```sh\nstated support\n```\n\nThe stated support is not.\n", [7]),
        ("The prior support.\n", []),
    ],
    ids=["broken over lines, in any case, whole words", "code", "the term"],
)
def test_words_are_found_in_prose(text, lines):
    found = faults("README.md", text, [Word("stated support", "prior support")])
    assert found == [f"README.md:{line}: 'stated support': write 'prior support'" for line in lines]


def test_a_capital_letter_is_found_alone():
    assert len(faults("README.md", "Take it, or else leave it. Else it stays.\n", [Word("Else", "Otherwise")])) == 1


def test_a_word_is_free_in_other_documents():
    word = [Word("stated support", "prior support", READMES)]
    assert faults("nodes/a/README.md", "stated support", word)
    assert not faults("nodes/a/FIGURES.md", "stated support", word)
