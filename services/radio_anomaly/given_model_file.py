"""The model file that a person or a bridge puts in place, read again when another stands there."""

from __future__ import annotations

from pathlib import Path

from services.radio_anomaly.radio_model import RadioModel
from services.radio_anomaly.radio_model_file import read_model

Mark = tuple[int, int, int]


class GivenModelFile:
    """One path. A bridge renames a new file, or a link to it, into place, so that what is read is whole."""

    def __init__(self, path: Path) -> None:
        """Nothing read yet."""
        self.path = path
        self._mark: Mark | None = None

    def read(self) -> RadioModel:
        """The model. Raises ValueError for what is none, OSError."""
        self._mark = self._marked()
        return read_model(self.path)

    def changed(self) -> bool:
        """Whether another file stands there than the one read last; False while none does."""
        mark = self._marked()
        return mark is not None and mark != self._mark

    def _marked(self) -> Mark | None:
        try:
            found = self.path.stat()
        except OSError:
            return None
        return found.st_ino, found.st_size, found.st_mtime_ns
