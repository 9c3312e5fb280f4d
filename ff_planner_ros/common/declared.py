"""Fields that are declared once, beside the class that they belong to.

The readers and writers of files and messages, the checks of the class and the JSON Schema of the
file all derive from these declarations.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cache
from operator import attrgetter
from typing import Any, TypeAlias

import numpy as np

from ff_planner_ros.common.arrays import zero_vector
from ff_planner_ros.common.forms import (
    NAME,
    NUMBERS,
    TRUTH,
    Form,
    a_number,
    a_vector,
    a_whole_number,
    a_word,
)
from ff_planner_ros.common.plain_values import an_object, dotted, mapping
from ff_planner_ros.errors import Faults, InvalidInput


@dataclass(frozen=True)
class DeclaredField:
    """The declaration of a field: its form, description, and place in files and messages."""

    form: Form
    sentence: str  # the description
    key: str = ""  # in files, dotted within its class's mapping; empty: the field's name
    unit: str = ""
    frame: str = ""  # of a vector
    # Path in the message of the class, dotted; `name[0]` is the entry of an array that has one at
    # most; None: not in messages
    message: str | None = None
    optional: bool = False  # whether a file may omit it although the class has no default
    brief: bool = False  # whether files that are written omit the default
    # An alternative key, its form and its description
    instead: tuple[str, Form, str] | None = None
    # Another key, its value with which this field may be omitted, and the field's value then
    unless: tuple[str, str, Any] | None = None
    name: str = ""  # the dataclass field's; dotted: of a part that is declared inline
    default: Any = field(default_factory=lambda: MISSING)

    @property
    def empties(self) -> bool:
        """Whether an empty value in a message stands for the default, which is not empty itself."""
        usual = self.default
        return usual is None or (usual is not MISSING and bool(np.any(usual)))

    @property
    def required(self) -> bool:
        """Whether every file must give it: it has neither a default nor an alternative key."""
        return not (self.optional or self.instead)


# A sentence, and a unit in brackets at its end.
_UNIT = re.compile(r"^(.*?)(?: \[([^\[\]]*)\])?$")

DeclaredFields: TypeAlias = Mapping[str, DeclaredField]  # by key


def declare(form: Form, sentence: str, **more: Any) -> Any:
    """Declare a field of a dataclass, whose `default` or `default_factory` is given as usual.

    Args:
        **more: Further attributes of `DeclaredField`.
    """
    usual = {name: more[name] for name in ("default", "default_factory") if name in more}
    more.pop("default_factory", None)
    return field(metadata={"declared": DeclaredField(form, sentence, **more)}, **usual)


def tunable(
    default: Any,
    sentence: str,
    within: tuple[Any, Any] = (0.0, None),
    words: Iterable[str] = (),
    key: str = "",
) -> Any:
    """Declare a tunable with its default, which has the type of its values.

    Args:
        sentence: What it means, and its unit in brackets at the end.
        within: Least and largest number; None: there is none.
        words: What a text may be; empty: any text.
        key: Its full name, if it does not follow from group and field.
    """
    low, high = within
    if words:
        form = a_word(words)
    elif isinstance(default, bool | str):
        form = TRUTH if isinstance(default, bool) else NAME
    elif isinstance(default, int):
        form = a_whole_number(int(low), high)
    else:
        form = NUMBERS if isinstance(default, tuple) else a_number(at_least=low, at_most=high)
    meaning, unit = _UNIT.findall(sentence)[0]
    return declare(form, meaning, unit=unit, key=key, default=default)


def declare_velocity(part: str, sentence: str, brief: bool = False) -> Any:
    """Declare the `linear` or `angular` velocity of a body, zero by default."""
    unit = {"linear": "m/s", "angular": "rad/s"}[part]
    more = {"unit": unit, "brief": brief, "message": f"twist.{part}"}
    return declare(a_vector(), sentence, default_factory=zero_vector, **more)


def declare_inline(kind: type[Any], **usual: Any) -> Any:
    """Declare a field for an object whose keys stand among those of the class that has it."""
    return field(metadata={"inline": kind}, **usual)


def inlined(kind: Any) -> dict[str, type[Any]]:
    """Return the classes of the fields of a class that are declared inline, by field name."""
    return {one.name: one.metadata["inline"] for one in fields(kind) if "inline" in one.metadata}


def declared(kind: Any) -> DeclaredFields:
    """Return the declarations of a dataclass's fields by key, in the order of files.

    Class attributes: `BESIDE` holds declarations of keys that are not fields; `FIRST` the keys that
    files begin with, if not in the order of the fields.
    """
    return _declared(kind)


@cache
def _declared(kind: Any) -> DeclaredFields:
    found: dict[str, DeclaredField] = dict(vars(kind).get("BESIDE", {}))
    inner = inlined(kind)
    for item in fields(kind):
        if item.name in inner:
            of_part = declared(inner[item.name]).items()
            found |= {key: replace(one, name=f"{item.name}.{one.name}") for key, one in of_part}
        one: DeclaredField | None = item.metadata.get("declared")
        if one is not None:
            default = item.default
            if item.default_factory is not MISSING:
                default = item.default_factory()
            one = replace(one, name=item.name, default=default)
            found[one.key or item.name] = replace(
                one, optional=one.optional or default is not MISSING
            )
    first = [key for key in vars(kind).get("FIRST", ()) if key in found]
    return {key: found[key] for key in dict.fromkeys([*first, *found])}


@cache
def declared_by_name(kind: Any) -> Mapping[str, DeclaredField]:
    """Return the declarations of a dataclass's fields by field name."""
    return {one.name: one for one in declared(kind).values()}


def check_declared(self: Any, block: str, **kinds: type[Any]) -> None:
    """Check every declared field of a frozen dataclass, and store the values as checked.

    Args:
        block: Prefix of the keys in errors.
        **kinds: Classes of fields that are not declared, by name.

    Raises:
        InvalidInput: A value is not allowed.
    """
    for name, kind in kinds.items():
        value = getattr(self, name)
        if not (value is None and getattr(type(self), name, self) is None):
            an_object(dotted(block, name), value, kind)
    for key, one in declared(type(self)).items():
        if not one.name or "." in one.name:
            continue
        value = getattr(self, one.name)
        if not (value is None and one.default is None):
            object.__setattr__(self, one.name, one.form.checked(dotted(block, key), value))


def read_keys(
    known: DeclaredFields, field: str, value: object, faults: Faults, named: str = ""
) -> dict[str, Any]:
    """Return the values of a file's mapping by dotted key; keys that it omits are absent.

    Args:
        field: Name of the mapping in errors.
        faults: Collects every key that is unknown or missing, and every wrong value.
        named: Name of the mapping in errors of values that were read; empty: `field`.
    """
    read = dict[str, Any]()
    _read_level(known, (field, named or field), value, "", (faults, read))
    return read


def _read_level(
    known: DeclaredFields,
    places: tuple[str, str],
    value: object,
    prefix: str,
    into: tuple[Faults, dict[str, Any]],
) -> None:
    """Read one level of a mapping whose keys may be dotted."""
    faults, read = into
    field, named = places
    level = dict(level_of(known, prefix))
    heads, instead = _heads(level)
    must = [head for head, one in level.items() if must_be_given(known, prefix + head, one)]
    with faults.gathered():
        mapping(field, value, must, [head for head in heads if head not in must])
    if not isinstance(value, dict):
        return
    for head in (head for head in heads if head in value):
        here, called = dotted(field, head), dotted(named, head)
        one = level.get(instead.get(head, head))
        inner, given = _apart(known, prefix + instead.get(head, head), value[head])
        if inner is not MISSING:
            _read_level(known, (here, called), inner, f"{prefix}{head}.", into)
        if given is MISSING or one is None:
            continue
        with faults.gathered():
            if head not in instead:
                read[prefix + head] = found = one.form.read(here, given)
                if not isinstance(found, dict):  # values of a part, checked one by one
                    one.form.checked(called, found)
            elif one.instead and (found := one.instead[1].read(here, given)) is not False:
                read[prefix + instead[head]] = found  # what is given instead is whole
    for head in instead.values():
        with faults.gathered():
            if (usual := _usual(level[head], field, head, value)) is not None:
                read[prefix + head] = usual


def _usual(one: DeclaredField | None, field: str, head: str, value: dict[str, Any]) -> Any:
    """Return what a value is that may be left out; None: it, or something instead, is given.

    Raises:
        InvalidInput: Neither is given, or both are.
    """
    if one is None or one.instead is None:
        return None
    other = one.instead[0]
    given = [name for name in (head, other) if value.get(name, False) is not False]
    if len(given) == 1:
        return None
    if not given and one.unless is not None and value.get(one.unless[0]) == one.unless[1]:
        return one.unless[2]
    found, allowed = "given twice" if given else "missing", f"give it or {other}"
    raise InvalidInput(one.form.absent, dotted(field, head), found, allowed)


def level_of(known: DeclaredFields, prefix: str) -> Iterator[tuple[str, DeclaredField | None]]:
    """Yield the first parts of keys behind a prefix; None: of keys that go on."""
    for key, one in known.items():
        if key.startswith(prefix):
            head, _, rest = key.removeprefix(prefix).partition(".")
            if not (rest and prefix + head in known):
                yield head, None if rest else one


def _heads(level: Mapping[str, DeclaredField | None]) -> tuple[list[str], dict[str, str]]:
    """Return the keys of a level with alternative ones behind theirs, and whose those are."""
    instead = {one.instead[0]: head for head, one in level.items() if one and one.instead}
    heads = list(level)
    for other, head in instead.items():
        heads.insert(heads.index(head) + 1, other)
    return heads, instead


def _apart(known: DeclaredFields, key: str, given: Any) -> tuple[Any, Any]:
    """Return what dotted keys say of a key's mapping, and the rest; MISSING: there is nothing."""
    if key not in known:
        return given, MISSING
    beside = keys_beside(known, key)
    if not isinstance(given, dict) or beside.keys().isdisjoint(given):
        return MISSING, given
    rest = {name: given[name] for name in given if name not in beside}
    return {name: given[name] for name in given if name in beside}, rest or MISSING


def keys_beside(known: DeclaredFields, key: str) -> DeclaredFields:
    """Return the keys that stand among those of another key's mapping, without that key."""
    inner = f"{key}."
    return {name.removeprefix(inner): one for name, one in known.items() if name.startswith(inner)}


def must_be_given(known: DeclaredFields, key: str, one: DeclaredField | None) -> bool:
    """Return whether every file must give a key, or one that goes on from it."""
    if one is not None:
        return one.required
    return any(inner.required for name, inner in known.items() if name.startswith(f"{key}."))


def fields_of(kind: type[Any], read: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values that were read for a class's fields, by field name instead of key."""
    given = {one.name: read[key] for key, one in declared(kind).items() if key in read}
    parts = {name: part(**fields_of(part, read)) for name, part in inlined(kind).items()}
    return {name: value for name, value in given.items() if name and "." not in name} | parts


def written_object(value: Any) -> dict[str, Any]:
    """Return the mapping that a file holds for an object with declared fields."""
    known = declared(type(value))
    values = {key: attrgetter(one.name)(value) for key, one in known.items() if one.name}
    return written(known, values)


def written(known: DeclaredFields, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the mapping that a file holds for values by dotted key; None is omitted.

    A form with a word for None (`spells_none`) writes the word instead.
    """
    document: dict[str, Any] = {}
    for key, one in known.items():
        value = values.get(key) if one.name else one.default
        if value is None and not one.form.spells_none:
            continue
        plain = one.form.written(value)
        if one.brief and plain == one.form.written(one.default):
            continue
        *groups, last = key.split(".")
        block = document
        for group in groups:
            block = block.setdefault(group, {})
        block[last] = plain
    return document
