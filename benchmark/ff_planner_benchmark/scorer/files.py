"""Reading a scenario's files from untrusted sources: their sizes are bounded."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import yaml

# Scenarios of the data set have 5 kB, their robots 50 kB, their lists five levels.
_MOST_BYTES, _DEEPEST, _MOST_VALUES = 1_000_000, 32, 50_000
_LARGEST = 1e6  # no number of a scenario that means something is larger
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def text_of(file: Path) -> str:
    """Return the text in a file.

    Raises:
        ValueError: It is no file, too large, or not UTF-8.
        OSError: It cannot be read.
    """
    if not file.is_file():  # a pipe or a device may let a reader wait for ever
        raise ValueError(f"{file.name} is no regular file")
    with file.open("rb") as stream:
        data = stream.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise ValueError(f"{file.name} is larger than {_MOST_BYTES / 1e6:g} MB")
    return data.decode()


def yaml_of(text: str) -> Any:
    """Return the document in a YAML text.

    Raises:
        ValueError: It is not YAML, is larger or deeper than a scenario, or a number is not finite.
    """
    try:
        depth = 0
        for values, event in enumerate(yaml.parse(text, Loader=_Loader)):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if isinstance(event, yaml.AliasEvent) or depth > _DEEPEST or values > _MOST_VALUES:
                raise ValueError("it has aliases, or is larger or deeper than a scenario")
        content = yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        raise ValueError(f"it is not YAML: {error}") from None
    _require_finite(content)
    return content


def json_of(text: str) -> Any:
    """Return the document in a JSON text.

    Raises:
        ValueError: It is not JSON, or nested too deep.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deep") from None


def xml_of(text: str) -> Element:
    """Return the root element of an XML text.

    Raises:
        ValueError: It is not XML, or has a document type declaration.
    """
    if "<!DOCTYPE" in text:  # an entity of a few bytes may stand for gigabytes
        raise ValueError("a URDF needs no <!DOCTYPE>")
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"it is not XML: {error}") from None


def _require_finite(value: Any) -> None:
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for one in value:
            _require_finite(one)
    elif isinstance(value, int | float) and not abs(value) < _LARGEST:
        raise ValueError("a number is infinite or too large")
