"""One example of every message, and the writer of the kept bytes.

`python -m tests.unit.schemas.examples` adds bytes of messages that have none yet, or whose
fields have grown. Bytes once kept are never changed: they are what older senders send.
"""

from __future__ import annotations

import json
from pathlib import Path

from schemas import topics
from schemas.codec import encode, encode_json
from schemas.message import Message
from tests.unit.schemas import (
    gnss_examples,
    motion_examples,
    operation_examples,
    radio_examples,
    track_circuit_examples,
)

EXAMPLES: dict[type[Message], Message] = (
    gnss_examples.EXAMPLES
    | motion_examples.EXAMPLES
    | track_circuit_examples.EXAMPLES
    | radio_examples.EXAMPLES
    | operation_examples.EXAMPLES
)


def keep_bytes(folder: Path) -> list[str]:
    """Write bytes and JSON of every example that no kept file covers; give the new names."""
    folder.mkdir(exist_ok=True)
    written = []
    for topic in topics.ALL:
        message = EXAMPLES[topic.message]
        fields = set(json.loads(encode_json(message)))
        kept = sorted(folder.glob(f"{topic.schema_name}.*.json"))
        if kept and set(json.loads(kept[-1].read_text("utf-8"))) == fields:
            continue
        name = f"{topic.schema_name}.{len(kept) + 1:03d}"
        (folder / f"{name}.msgpack").write_bytes(encode(message))
        (folder / f"{name}.json").write_bytes(encode_json(message))
        written.append(name)
    return written


if __name__ == "__main__":
    print(*keep_bytes(Path(__file__).parent / "old_bytes"), sep="\n")  # noqa: T201 - a script's output
