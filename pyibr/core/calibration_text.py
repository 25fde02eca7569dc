"""Calibration files as trees of mappings, lists, numbers and words: JSON, YAML, XML, INI, or rows of numbers."""

from __future__ import annotations

import itertools
import json
import re
from os import PathLike
from typing import TYPE_CHECKING, Any

from pyibr.core.camera_json import read_json
from pyibr.core.files import read_rows, read_text, reading, words_of

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_SECTION = re.compile(r"\[([^\[\]{}\",]*[^\[\]{}\",\d\s.][^\[\]{}\",]*)\]")
_ASSIGNED = re.compile(r"\w+\s*=")
_CHARACTERS_MAX, _VALUES_MAX = 1 << 22, 1 << 20  # of YAML


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
    word = word.strip()
    if word[:1] in ("'", '"'):
        return word[1:-1]
    if _is_number(word):
        return int(word) if re.fullmatch(r"[+-]?\d+", word) else float(word)
    known: dict[str, object] = {"true": True, "false": False, "null": None, "~": None, "": None}
    return known.get(word.lower(), word)


def _yaml(text: str) -> object:
    """The first document; tags do not affect a value."""
    import yaml

    if len(text) > _CHARACTERS_MAX:
        raise ValueError(f"it has {len(text)} characters; up to {_CHARACTERS_MAX} of YAML are read")
    if text.startswith("%"):  # OpenCV's files have %YAML:1.0, not %YAML 1.0, and {x:1}, not {x: 1}
        text = "#" + re.sub(r"([{,]\s+[\w-]+):(?=\S)", r"\1: ", text)
    count = itertools.count(1)

    def plain(node: yaml.Node) -> object:
        if next(count) > _VALUES_MAX:
            raise ValueError(f"it has more than {_VALUES_MAX} values, with repetitions by aliases")
        if isinstance(node, yaml.ScalarNode):
            return node.value if node.style else _value(node.value)
        if isinstance(node, yaml.SequenceNode):
            return [plain(item) for item in node.value]
        return {key.value: plain(value) for key, value in node.value}

    loader: Any = getattr(yaml, "CBaseLoader", yaml.BaseLoader)  # in C 15 times as fast; not all builds have it
    try:
        document = loader(text.expandtabs())
        return plain(document.get_node()) if document.check_node() else None
    except yaml.MarkedYAMLError as error:
        mark: Any = error.problem_mark
        raise ValueError(f"line {mark.line + 1}: {error.problem}") from None


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
