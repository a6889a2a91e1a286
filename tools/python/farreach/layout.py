"""Layouts of messages, from their schemas.

A message is a flat record of numbers and arrays of fixed length, in shared memory as in a
recording. Its schema (a `.msg` file, `ros2msg` in a recording) names the fields with their units,
and the codes that a field may hold.
"""

import ctypes
import re
from dataclasses import dataclass, field
from importlib import resources

import numpy as np

from .errors import LayoutError, NoSuchTopic

NUMBERS = {
    "int8": (np.int8, ctypes.c_int8),
    "uint8": (np.uint8, ctypes.c_uint8),
    "int16": (np.int16, ctypes.c_int16),
    "uint16": (np.uint16, ctypes.c_uint16),
    "int32": (np.int32, ctypes.c_int32),
    "uint32": (np.uint32, ctypes.c_uint32),
    "int64": (np.int64, ctypes.c_int64),
    "uint64": (np.uint64, ctypes.c_uint64),
    "float32": (np.float32, ctypes.c_float),
    "float64": (np.float64, ctypes.c_double),
}
# What a recording puts before each message: little-endian CDR.
CDR_HEADER = bytes([0, 1, 0, 0])


@dataclass(frozen=True)
class Layout:
    """Fields of a message type."""

    name: str
    """Name of the type, such as `Sample`."""
    type_name: str | None
    """Name in shared memory, with the version; `None` where the schema does not say."""
    dtype: np.dtype
    """Fields as numpy sees them, with their offsets."""
    descriptions: dict[str, str] = field(default_factory=dict)
    """What each field is, with its unit."""
    codes: dict[str, dict[int, str]] = field(default_factory=dict)
    """Of each field that holds a code: the names of the codes, in lower case."""

    @property
    def size(self):
        """Length of a message (bytes)."""
        return self.dtype.itemsize

    def names(self, field_name, values):
        """The names of the codes in an array of values of a field.

        >>> layout_of("sample").names("gate_state", [0, 1])
        ['closed', 'open']
        """
        if field_name not in self.codes:
            known = ", ".join(self.codes) or "none"
            raise LayoutError(f"{self.name}: {field_name} holds no codes; fields that do: {known}")
        codes = self.codes[field_name]
        return [codes.get(int(value), f"unknown code {int(value)}") for value in values]

    def texts(self, array, field_name="text"):
        """The texts in a field of bytes, such as those of events."""
        known = self.dtype.names
        of_bytes = field_name in known and self.dtype[field_name].base == np.uint8
        if not of_bytes or not self.dtype[field_name].shape:
            raise LayoutError(f"{self.name}: {field_name} holds no text")
        return [bytes(row).rstrip(b"\0").decode(errors="replace") for row in array[field_name]]

    def structure(self):
        """The message as a structure of ctypes, for iceoryx2."""
        fields = []
        for name in self.dtype.names:
            kind, _ = self.dtype.fields[name]
            number = NUMBERS[kind.base.name][1]
            fields.append((name, number * kind.shape[0] if kind.shape else number))
        type_name = self.type_name
        structure = type(
            self.name,
            (ctypes.Structure,),
            {"_fields_": fields, "type_name": staticmethod(lambda: type_name)},
        )
        if ctypes.sizeof(structure) != self.size:
            raise LayoutError(
                f"{self.name}: {ctypes.sizeof(structure)} bytes by the rules of C, and "
                f"{self.size} by its schema"
            )
        return structure


def parse(name, text):
    """Reads a schema: the text of a `.msg` file, or of a schema in a recording."""
    head = re.match(r"# [^\n]*?: (\d+) bytes, (farreach\.\w+\.v\d+) in shared memory",
                    re.sub(r"\n# ?", " ", text.partition("\n\n")[0]))
    names, formats, offsets = [], [], []
    descriptions, codes = {}, {}
    end, comment, pending = 0, [], []
    for line in text.splitlines():
        if line.startswith("#"):
            comment.append(line[1:].strip())
            continue
        if not line.strip():
            comment = []
            continue
        if constant := re.fullmatch(r"\w+ ([A-Z]\w*)=(-?\d+)", line):
            pending.append((constant[1], int(constant[2])))
            continue
        found = re.fullmatch(r"(\w+)(?:\[(\d+)\])? (\w+)", line)
        if found is None or found[1] not in NUMBERS:
            raise LayoutError(
                f"{name}: expected a number or an array of numbers, found \"{line}\": nested, text "
                f"and variable types are not supported"
            )
        number = np.dtype(NUMBERS[found[1]][0]).newbyteorder("<")
        offset = -(-end // number.itemsize) * number.itemsize
        format_ = (number, (int(found[2]),)) if found[2] else number
        names.append(found[3])
        formats.append(format_)
        offsets.append(offset)
        end = offset + np.dtype(format_).itemsize
        descriptions[found[3]] = " ".join(comment)
        if pending:
            codes[found[3]] = _code_names(pending)
        comment, pending = [], []
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": end})
    if head and int(head[1]) != end:
        raise LayoutError(f"{name}: expected {head[1]} bytes, found fields of {end}")
    return Layout(name, head[2] if head else None, dtype, descriptions, codes)


def _code_names(constants):
    """Names without the part that all of them begin with."""
    words = [name.split("_") for name, _ in constants]
    shared = 0
    while all(len(each) > shared + 1 for each in words) and len({w[shared] for w in words}) == 1:
        shared += 1
    return {
        code: " ".join(each[shared:]).lower()
        for each, (_, code) in zip(words, constants, strict=True)
    }


def _published():
    return resources.files(__package__) / "published"


def topics():
    """The topics of a rig: name of the message type by topic."""
    rows = re.findall(
        r"^\| `([^`]+)` \| [^|]+ \| \[(\w+)\]\(schemas/",
        (_published() / "topics.md").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    return dict(rows)


def layout_of(topic):
    """The layout of a topic's messages, as this version of farreach publishes them."""
    known = topics()
    if topic not in known:
        raise NoSuchTopic(f"no topic \"{topic}\"; there are {', '.join(known)}")
    name = known[topic]
    text = (_published() / "schemas" / f"{name}.msg").read_text(encoding="utf-8")
    return parse(name, text)
