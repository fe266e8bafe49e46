"""What is said of a file that cannot be read at all, and of the parts of it that cannot."""

from __future__ import annotations

from services.gnss_receiver.observations import FileIssue

MAX_ISSUES = 1000
"""Issues kept one by one; a file of garbage must not fill the memory with complaints."""


class RinexError(ValueError):
    """A file that cannot be read as what it was given for: path, line, what is wrong and what to do."""

    def __init__(self, path: str, line: int, text: str) -> None:
        """Name the file and the line, counted from 1 (0: the file as a whole)."""
        super().__init__(f"{path}:{line}: {text}" if line else f"{path}: {text}")
        self.path = path
        self.line = line
        self.text = text


class IssueLog:
    """Collects what was refused in one file, bounded; the rest is counted."""

    def __init__(self, path: str) -> None:
        """Start without issues for the file named `path`."""
        self.path = path
        self._issues: list[FileIssue] = []
        self._more = 0
        self._last_line = 0

    def add(self, line: int, text: str) -> None:
        """Note that `text` is wrong at `line`, counted from 1."""
        if len(self._issues) < MAX_ISSUES:
            self._issues.append(FileIssue(self.path, line, text))
        else:
            self._more += 1
            self._last_line = line

    def count(self, extra: int, line: int) -> None:
        """Note `extra` further issues, the last at `line`, without their text."""
        if extra > 0:
            self._more += extra
            self._last_line = line

    def issues(self) -> tuple[FileIssue, ...]:
        """Everything noted, in the order of the lines; the last one counts what was not kept."""
        ordered = sorted(self._issues, key=lambda issue: issue.line)
        if self._more:
            ordered.append(FileIssue(self.path, self._last_line, f"and {self._more} more issues like these"))
        return tuple(ordered)
