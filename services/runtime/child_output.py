"""How the supervisor passes on what its processes print. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field

import msgspec

COLOURS = (36, 32, 35, 33, 34, 96, 92, 95)
"""ANSI foreground colours that are legible on dark and on light."""
MAX_LINE_BYTES = 1 << 20


@dataclass(slots=True)
class LineSplitter:
    """Whole lines from chunks of bytes; a line longer than 1 MiB is cut."""

    _rest: bytes = b""

    def take(self, chunk: bytes) -> list[bytes]:
        """Lines that are complete with this chunk."""
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        if len(self._rest) > MAX_LINE_BYTES:
            lines.append(self._rest)
            self._rest = b""
        return lines

    def finish(self) -> list[bytes]:
        """What came without a line end."""
        rest, self._rest = self._rest, b""
        return [rest] if rest else []


@dataclass(slots=True)
class OutputStyle:
    """Dresses lines of several processes for one stream."""

    json: bool
    colour: bool
    width: int = 12
    _colours: dict[str, int] = field(default_factory=dict)

    def dressed(self, name: str, line: bytes, *, error: bool) -> str:
        """Line with its sender in front; in JSON as it is, or wrapped when it is no JSON line.

        >>> OutputStyle(json=False, colour=False).dressed("recorder", b"ready", error=False)
        'recorder     | ready'
        """
        text = line.decode("utf-8", "backslashreplace").rstrip("\r")
        if self.json:
            if text.startswith("{") and text.endswith("}") and not error:
                return text
            event = {"event": "output", "service": name, "stream": "stderr" if error else "stdout", "text": text}
            return msgspec.json.encode(event).decode()
        label = name.ljust(self.width)
        if self.colour:
            shade = self._colours.setdefault(name, COLOURS[len(self._colours) % len(COLOURS)])
            label = f"\x1b[{shade}m{label}\x1b[0m"
        return f"{label} {'!' if error else '|'} {text}"
