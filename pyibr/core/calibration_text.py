"""Text of calibration files as trees of mappings, lists, numbers and words: JSON, YAML, XML, INI, or rows of numbers.

The YAML reader covers the output of calibration programs: blocks, lists and mappings in brackets, comments, tags; it
reads the first of several documents. A strict parser would refuse OpenCV's files, which begin with `%YAML:1.0`.
"""

from __future__ import annotations

import json
import re
from os import PathLike
from typing import TYPE_CHECKING

from pyibr.core.camera_json import read_json
from pyibr.core.files import read_rows, read_text, reading, words_of

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_Line = tuple[int, str]  # a line of YAML: its indent, and its text
_SECTION = re.compile(r"\[([^\[\]{}\",]*[^\[\]{}\",\d\s.][^\[\]{}\",]*)\]")
_ASSIGNED = re.compile(r"\w+\s*=")
_ENTRY = re.compile(r"(\"[^\"]*\"|'[^']*'|[^\s\"'\[{][^:]*?)\s*:(?:\s+(.*))?$")
_TAGS = r"^(?:[!&][^\s\[{]*\s*)+"  # also anchors, which do not affect a value
_REMARK = re.compile(r"(\"[^\"]*\"|'[^']*')|(?:^|\s)#.*")
_TOKEN = re.compile(r"[\[\]{},]|\"[^\"]*\"(?:\s*:)?|'[^']*'(?:\s*:)?|[^\[\]{},\s:][^\[\]{},:]*:?|:")


def read_tree(path: str | PathLike[str]) -> object:
    """Return a calibration file's content in any of the formats; FileFormatError if none fits."""
    if str(path).lower().endswith(".json"):
        return read_json(path, "camera JSON")
    with reading(path, "camera") as source:
        if source.suffix.lower() == ".npy":
            return read_rows(source)
        text = read_text(source)
        rows = [words for line in text.splitlines() if (words := words_of(line.partition("#")[0]))]
        if all(_is_number(word) for row in rows for word in row):
            return [[float(word) for word in row] for row in rows]
        head = text.lstrip()
        if _SECTION.match(head):
            return _ini(text)
        if head.startswith(("{", "[")):
            return json.loads(text)
        if head.startswith("<"):
            return _xml(text)
        if _ASSIGNED.match(head):
            return _assigned(text)
        return _yaml(text)


def _assigned(text: str) -> dict[str, object]:
    """Lines `name = value`, where brackets enclose the numbers of a matrix."""
    pairs = [line.partition("=") for line in text.splitlines() if line.strip()]
    return {
        name.strip(): [float(word) for word in words_of(value)] if "[" in value else _value(value)
        for name, _, value in pairs
    }


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _value(word: str) -> object:
    """A number, a bool, None or a word."""
    word = re.sub(_TAGS, "", word.strip())
    if word[:1] in ("'", '"'):
        return word[1:-1]
    if _is_number(word):
        return int(word) if re.fullmatch(r"[+-]?\d+", word) else float(word)
    known: dict[str, object] = {"true": True, "false": False, "null": None, "~": None, "": None}
    return known.get(word.lower(), word)


def _yaml(text: str) -> object:
    lines: list[tuple[int, list[str]]] = []  # indent and parts of each entry; open brackets continue it
    depth = 0
    for line in text.expandtabs().splitlines():
        if line.startswith(("%", "---", "...")):
            if lines:
                break
            continue
        bare = _REMARK.sub(lambda found: found[1] or "", line).rstrip()
        if bare and depth <= 0:
            lines.append((len(bare) - len(bare.lstrip()), []))
        if bare:
            lines[-1][1].append(bare.strip())
            depth += sum(bare.count(sign) for sign in "[{") - sum(bare.count(sign) for sign in "]}")
    left = [(indent, " ".join(parts)) for indent, parts in reversed(lines)]
    tree = _block(left)
    if left:
        raise ValueError(f"cannot tell what {left[-1][1]!r} belongs to")
    return tree


def _block(lines: list[_Line]) -> object:
    """The list, mapping or value at the start of the lines, which are in reverse order."""
    indent, text = lines[-1]
    if _is_item(text):
        items: list[object] = []
        while lines and lines[-1][0] == indent and _is_item(lines[-1][1]):
            text = lines.pop()[1]
            rest = text[1:].lstrip()
            if rest:
                lines.append((indent + len(text) - len(rest), rest))
            items.append(_block(lines) if rest or (lines and lines[-1][0] > indent) else None)
        return items
    if not _ENTRY.match(text):
        return _inline(lines.pop()[1])
    entries: dict[str, object] = {}
    while lines and lines[-1][0] == indent and (entry := _ENTRY.match(lines[-1][1])):
        lines.pop()
        key, rest = str(_value(entry[1])), entry[2] or ""
        is_below = lines and (lines[-1][0] > indent or (lines[-1][0] == indent and _is_item(lines[-1][1])))
        entries[key] = _block(lines) if is_below and _value(rest) is None else _inline(rest)
    return entries


def _is_item(text: str) -> bool:
    return text == "-" or text.startswith("- ")


def _inline(text: str) -> object:
    bare = re.sub(_TAGS, "", text)
    return _bracket(_TOKEN.findall(bare)[::-1]) if bare.startswith(("[", "{")) else _value(bare)


def _bracket(tokens: list[str]) -> object:
    """The value at the start of the tokens, which are in reverse order."""
    opening = tokens.pop()
    if opening not in ("[", "{"):
        return _value(opening)
    items: list[object] = []
    entries: dict[str, object] = {}
    while tokens and (token := tokens[-1]) not in ("]", "}"):
        if token == ",":
            tokens.pop()
        elif token.endswith(":"):
            key = str(_value(tokens.pop()[:-1]))
            entries[key] = _bracket(tokens)
        else:
            items.append(_bracket(tokens))
    if not tokens:
        raise ValueError("a bracket is not closed")
    tokens.pop()
    return items if opening == "[" else entries


def _xml(text: str) -> object:
    from xml.etree import ElementTree

    if "<!DOCTYPE" in text:  # its entities may expand without limit
        raise ValueError("a DOCTYPE is not allowed")
    return _element(ElementTree.fromstring(text))


def _element(element: Element) -> object:
    if not len(element):
        values = [_value(word) for word in (element.text or "").split()]
        is_list = len(values) > 1 and all(isinstance(value, (int, float)) for value in values)
        return values if is_list else _value(element.text or "")
    if all(child.tag == "_" for child in element):
        return [_element(child) for child in element]
    return {child.tag: _element(child) for child in element}


def _ini(text: str) -> object:
    """Sections of `key = value`, or, in ROS's form, of a key's line followed by lines of numbers."""
    tree: dict[str, dict[str, object]] = {}
    section: dict[str, object] = {}
    numbers: list[object] = []
    for line in (line.strip() for line in text.splitlines()):
        name = _SECTION.fullmatch(line)
        if not line or line[0] in "#;":
            continue
        if name:
            section = tree.setdefault(name[1].strip(), {})
        elif "=" in line:
            key, _, value = line.partition("=")
            section[key.strip()] = _value(value)
        elif all(_is_number(word) for word in line.split()):
            numbers += [_value(word) for word in line.split()]
        else:
            numbers = []
            section[line] = numbers
    return tree
