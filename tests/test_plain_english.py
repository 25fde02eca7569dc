"""Sentences are plain: few of them use a clause where the field has a noun, or leave out their subject."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
GROUPS = {
    "manual": ("docs", "README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md"),
    "package": ("pyibr",),
    "kernels": ("kernels",),
    "tests": ("tests",),
    "benchmarks": ("benchmarks", "tools", ".ci"),
}
SHARE_MAX = 0.01  # some finds are plain English
WORDS_MIN = 4  # shorter texts are labels
ASKING = r"(?<!know )(?<!knows )(?<!show )(?<!shows )(?<!see )(?<!says )(?<!say )(?<!ask )(?<!asks )(?<!decides )"
RIDDLES = (
    r"^Of (?!course\b)",
    r"[;:] of (which|what|those|a|an|the|several|two|its)\b",
    r"^(What|Who|Whose|Whoever|Whatever|Those) (?!.*\?)",
    rf"{ASKING}\b(what|who) (is|are|has|have|was|were|lies?|stands?|belongs|remains|follows)\b(?!.*\?)",
    r"(?<!than )(?<!as )(?<!like )(?<!to )(?<!from )(?<!with )\b[Tt]hose (of|in|at|by|with|without|beside)\b",
    r"(?<!one )(?<!each )(?<!both )(?<!all )(?<!some )(?<!none )(?<!most )\bof (which|whom)\b",
    r"\b(is|are|was|were) told\b",
    r"\bbut for\b",
    r"\bby (what|whom)\b",
    r"\b(for|to|of|with) who(ever)?\b",
    r"\b[Tt]he ones (of|in|with|by|at|for|from)\b|\b[Tt]hat which\b",
    r"\bas of (the|a|an|its)?\s?`?\w+\.(cl|h|py)\b",
    r"\baslant\b",
)
"""What the project's own texts once used in place of plain sentences."""


def texts_of_python(path: Path) -> Iterator[str]:
    """Docstrings without their examples, other strings of several words, and comments."""
    source = path.read_text()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield re.sub(r"(?m)^\s*(>>>|\.\.\.).*(\n(?!\s*\n).*)*", "", node.value)
    comments = [t for t in tokenize.generate_tokens(io.StringIO(source).readline) if t.type == tokenize.COMMENT]
    block: list[str] = []
    for before, comment in zip([None, *comments], comments, strict=False):
        follows = before and comment.start[0] == before.start[0] + 1 and not comment.line[: comment.start[1]].strip()
        if not follows:
            yield " ".join(block)
            block = []
        block.append(comment.string.lstrip("#: "))
    yield " ".join(block)


def texts_of_kernel(path: Path) -> Iterator[str]:
    """Comments."""
    for comment in re.findall(r"/\*.*?\*/|(?://[^\n]*\n\s*)+", path.read_text(), re.S):
        yield re.sub(r"(?m)^\s*(\*|//)|/\*|\*/", "", comment)


def texts_of_page(path: Path) -> Iterator[str]:
    """Paragraphs, items of lists and cells of tables, without headings and code."""
    text = re.sub(r"```.*?```|(?m:^#[^\n]*$)|(?m:^\[[^\n]*?\]:[^\n]*$)", "", path.read_text(), flags=re.S)
    for part in re.split(r"\n\s*\n|\n(?=[|*-] )|\n(?=\d+\. )", text):
        yield from part.split("|")


READERS = {".py": texts_of_python, ".md": texts_of_page, ".cl": texts_of_kernel, ".h": texts_of_kernel}


def sentences_of(path: Path) -> Iterator[str]:
    """Return a file's sentences of a few words and more; code in backquotes counts as a word."""
    for text in READERS[path.suffix](path):
        for part in re.split(r"\n\s*\n|\n(?=\s*\w[\w, *]* : )", text):
            words = re.sub(r"`[^`]*`", lambda code: "`" + re.sub(r"\W+", "_", code[0]) + "`", part)
            for sentence in re.split(r"(?<=[.;:!?])\s+(?=[A-Z`*(\[])", re.sub(r"\s+", " ", words)):
                if len(re.findall(r"\b[a-zA-Z]{2,}\b", sentence)) >= WORDS_MIN:
                    yield sentence.strip(" *-`_#")


def is_riddle(sentence: str) -> bool:
    """Does a sentence use one of the forms?"""
    return any(re.search(form, sentence) for form in RIDDLES)


def test_riddles_are_found():
    assert is_riddle("Of what is merged to a count, no vertex lies off the planes.")
    assert is_riddle("What it will print once that is done is returned.")
    assert is_riddle("the members of which are those of the kernel's struct")
    assert not is_riddle("Returns the line that it prints when it is done.")
    assert not is_riddle("The margins of connected surfaces are wider than those of cut ones.")


@pytest.mark.thorough
@pytest.mark.parametrize("group", GROUPS)
def test_texts_are_plain(group: str):
    places = [ROOT / name for name in GROUPS[group]]
    files = [file for place in places for file in ([place] if place.is_file() else sorted(place.rglob("*")))]
    skipped = {"results", "build", "__pycache__", Path(__file__).name}
    files = [file for file in files if file.suffix in READERS and not skipped & set(file.parts)]
    found = [(file.relative_to(ROOT), sentence) for file in files for sentence in sentences_of(file)]
    riddles = [f"{file}: {sentence}" for file, sentence in found if is_riddle(sentence)]
    assert len(riddles) <= SHARE_MAX * len(found), "\n".join(riddles)
