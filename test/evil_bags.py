"""MCAP files that are small, and large for those who believe them."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator, Mapping

import lz4.frame
import zstandard

from ff_planner_ros.bag.exchanges import EXCHANGE
from ff_planner_ros.bag.mcap.definition import message_definition

MAGIC = b"\x89MCAP0\r\n"
# Opcodes of MCAP: https://mcap.dev/spec
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 1, 2, 3, 4, 5, 6
CHUNK_INDEX, ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, DATA_END, PRIVATE = 8, 9, 10, 11, 15, 0x90
GIGABYTE, MEGABYTE = 1 << 30, 1 << 20
TOPIC = "/exchanges"


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def text(words: str | bytes) -> bytes:
    data = words.encode() if isinstance(words, str) else words
    return struct.pack("<I", len(data)) + data


def schema(number: int, name: str, encoding: str, definition: str | bytes) -> bytes:
    head = struct.pack("<H", number) + text(name) + text(encoding)
    return record(SCHEMA, head + text(definition))


def channel(number: int, topic: str) -> bytes:
    head = struct.pack("<HH", number, number) + text(topic) + text("cdr")
    return record(CHANNEL, head + struct.pack("<I", 0))


def message(number: int, cdr: bytes, time: int = 5) -> bytes:
    return record(MESSAGE, struct.pack("<HIQQ", number, 0, time, time) + cdr)


def chunk(data: bytes, compression: str, size: int) -> bytes:
    head = struct.pack("<QQQI", 0, 1, size, 0) + text(compression)
    return record(CHUNK, head + struct.pack("<Q", len(data)) + data)


def compressed(records: bytes) -> bytes:
    return chunk(zstandard.compress(records), "zstd", len(records))


def attachment(name: str, data: bytes) -> bytes:
    head = struct.pack("<QQ", 0, 0) + text(name) + text("x")
    return record(ATTACHMENT, head + struct.pack("<Q", len(data)) + data + bytes(4))


def whole_records(data: bytes) -> Iterator[tuple[int, int]]:
    """Yield opcode and end of each whole record of a file that may be cut anywhere."""
    end, head = len(MAGIC), struct.Struct("<BQ")
    while end + head.size <= len(data):
        opcode, length = head.unpack_from(data, end)
        end += head.size + length
        if end <= len(data):
            yield opcode, end


HEAD = MAGIC + record(HEADER, text("ros2") + text("test"))
END = record(DATA_END, bytes(4))
EXCHANGES = schema(1, EXCHANGE, "ros2msg", message_definition(EXCHANGE).text)
EXCHANGES += channel(1, TOPIC)


def zeros(gigabytes: int, tells_size: bool) -> bytes:
    """Gigabytes of zeros in kilobytes."""
    compressor = zstandard.ZstdCompressor(level=1, write_content_size=tells_size)
    file, piece = io.BytesIO(), bytes(16 * MEGABYTE)
    size = gigabytes * GIGABYTE if tells_size else -1
    with compressor.stream_writer(file, size=size, closefd=False) as writer:
        for _ in range(gigabytes * GIGABYTE // len(piece)):
            writer.write(piece)
    return file.getvalue()


def zeros_in_lz4() -> bytes:
    compressor, piece = lz4.frame.LZ4FrameCompressor(), bytes(16 * MEGABYTE)
    pieces = [compressor.begin(), *(compressor.compress(piece) for _ in range(64))]
    return b"".join([*pieces, compressor.flush()])


def indexed(records: bytes, entries: bytes) -> bytes:
    """A file with an index that names what it likes."""
    body = HEAD + EXCHANGES + records + END
    statistics = record(STATISTICS, struct.pack("<QHIIIIQQI", 1, 1, 1, 0, 0, 1, 0, 10, 0))
    footer = record(FOOTER, struct.pack("<QQI", len(body), 0, 0))
    return body + EXCHANGES + entries + statistics + footer + MAGIC


def attached_often(times: int) -> bytes:
    document = attachment("robot.urdf", bytes(MEGABYTE))
    entry = struct.pack("<QQQQQ", len(HEAD + EXCHANGES), len(document), 0, 0, MEGABYTE)
    return indexed(document, record(ATTACHMENT_INDEX, entry + text("a") + text("b")) * times)


def attached_within_each_other(depth: int) -> bytes:
    document = b""
    for _ in range(depth):
        document = attachment("a", document + bytes(300))
    step = len(attachment("a", b"")) - 4  # behind the head of one begins the next
    places = (len(HEAD + EXCHANGES) + step * number for number in range(depth))
    entries = (struct.pack("<QQQQQ", at, 1, 0, 0, 1) + text("a") + text("b") for at in places)
    return indexed(document, b"".join(record(ATTACHMENT_INDEX, entry) for entry in entries))


def chunk_named_often(times: int) -> bytes:
    records = compressed(message(1, b"") * 100_000)
    size = struct.pack("<QQ", len(records), 3_100_000)
    place = struct.pack("<QQQQ", 0, 10, len(HEAD + EXCHANGES), len(records))
    entry = place + struct.pack("<IQ", 0, 0) + text("zstd") + size
    return indexed(records, record(CHUNK_INDEX, entry) * times)


def defined(fields: str, held: str = "", cdr: bytes = b"\xff" * 400) -> bytes:
    """Exchanges of a definition of their own, in IDL: its fields, and the types that they hold."""
    exchange = f"{held} struct Exchange {{ {fields} }};"
    return described("ros2idl", f"module ff_planner_msgs {{ module msg {{ {exchange} }}; }};", cdr)


def described(encoding: str, definition: str, cdr: bytes = bytes(400)) -> bytes:
    records = schema(1, EXCHANGE, encoding, definition) + channel(1, TOPIC)
    return HEAD + records + message(1, b"\0\1\0\0" + cdr) * 3 + END


def doubled_types(levels: int) -> str:
    """Each type holds the next one ten times."""
    fields = (
        " ".join(f"ff_planner_msgs::msg::B{level + 1} f{k};" for k in range(10))
        for level in range(levels)
    )
    types = [f"struct B{level} {{ {text} }};" for level, text in enumerate(fields)]
    return " ".join([*types, f"struct B{levels} {{ octet x; }};"])


def with_a_number(for_plans: bool) -> bytes:
    """A number is where an answer has its plans, or else where a request has an approach."""
    held = """
        struct T { long sec; unsigned long nanosec; };
        struct H { ff_planner_msgs::msg::T stamp; };
        struct G { double approach; };
        struct R { ff_planner_msgs::msg::G goal; };
        struct S { long code; string message; };
        struct O { double solve_time; };
        struct I { sequence<double> first_guess; };
        struct A { ff_planner_msgs::msg::S status; ff_planner_msgs::msg::O solver;
                   ff_planner_msgs::msg::I inputs; double plans; };
    """
    fields = """
        ff_planner_msgs::msg::H header; string plan_id; string interface; string requester;
        string event; sequence<ff_planner_msgs::msg::R> request; string task; string versions;
        sequence<ff_planner_msgs::msg::A> answer;
    """
    word = struct.pack("<IBxxx", 1, 0)
    request = bytes(4) if for_plans else struct.pack("<Ixxxxd", 1, 0.5)
    answer = struct.pack("<Ii", 1, 0) + word + struct.pack("<xxxxdIxxxxd", 0.1, 0, 0.5)
    told = bytes(8) + 4 * word + request + 2 * word + (answer if for_plans else bytes(4))
    return defined(fields, held, told)


EVIL_BAGS: Mapping[str, Callable[[], bytes]] = {
    "a chunk of 4 GiB": lambda: (
        HEAD + EXCHANGES + chunk(zeros(4, tells_size=True), "zstd", 4 * GIGABYTE) + END
    ),
    "a chunk that does not tell its 4 GiB": lambda: (
        HEAD + EXCHANGES + chunk(zeros(4, tells_size=False), "zstd", 100) + END
    ),
    "a chunk that tells 2^63 bytes": lambda: (
        HEAD + EXCHANGES + chunk(zeros(1, tells_size=False), "zstd", 1 << 63) + END
    ),
    "a chunk of lz4": lambda: HEAD + EXCHANGES + chunk(zeros_in_lz4(), "lz4", 100) + END,
    "a chunk of two million empty messages": lambda: (
        HEAD + EXCHANGES + compressed(message(1, b"") * 2_000_000) + END
    ),
    "many chunks of empty records": lambda: (
        HEAD + EXCHANGES + compressed(record(PRIVATE, b"") * 400_000) * 8 + END
    ),
    "4000 entries at one attachment": lambda: attached_often(4_000),
    "attachments within each other": lambda: attached_within_each_other(3_000),
    "4000 entries at one chunk": lambda: chunk_named_often(4_000),
    "60,000 schemas": lambda: (
        HEAD
        + b"".join(schema(i, f"a/B{i}", "x", "") + channel(i, f"/t{i}") for i in range(1, 60_000))
        + END
    ),
    "faults everywhere": lambda: HEAD + EXCHANGES + message(7, b"") * 50_000 + END,
    "heads of chunks everywhere": lambda: HEAD + b"\x04\0\0\0zstd" * 100_000,
    "a topic of a megabyte": lambda: (
        HEAD + EXCHANGES + schema(2, "a/B", "ros2msg", "int32 x") + channel(2, "/" * MEGABYTE) + END
    ),
    "times at the ends": lambda: (
        HEAD + EXCHANGES + b"".join(message(1, b"", time) for time in (0, 2**64 - 1, 2**63)) + END
    ),
    "a definition that doubles": lambda: defined("ff_planner_msgs::msg::B0 x;", doubled_types(9)),
    "a definition of itself": lambda: defined(
        "ff_planner_msgs::msg::B x;", "struct B { ff_planner_msgs::msg::B x; };"
    ),
    "a deep definition": lambda: described("ros2idl", "module a {" * 5_000),
    "an open definition": lambda: described("ros2idl", "module x_Constants {\n" * 2_800),
    "a long definition": lambda: described("ros2idl", "/*" * MEGABYTE),
    "4e9 of nearly nothing": lambda: defined(
        "ff_planner_msgs::msg::E x[4000000000];", "struct E { octet y; };"
    ),
    "4e9 strings": lambda: defined("sequence<string> x;"),
    "4e8 strings of its own": lambda: defined("string x[400000000];"),
    "4e9 numbers": lambda: defined("double x[4000000000];"),
    "an array of 5000 digits": lambda: defined(f"octet x[{'9' * 5_000}];"),
    "a number for an approach": lambda: with_a_number(for_plans=False),
    "a number for plans": lambda: with_a_number(for_plans=True),
}
