"""What frequency-coded circuits may send: carriers, shift, low-frequency codes, and what the codes mean."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

import msgspec
from msgspec import Meta

from services.track_circuit.profile import Profile

Frequency = Annotated[float, Meta(gt=0.0, le=20_000.0)]
CODES_HZ = tuple(round(10.3 + 1.1 * k, 1) for k in range(18))
"""The 18 low-frequency codes of UM71 and ZPW-2000."""


class Code(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One low-frequency code."""

    hz: Frequency
    meaning: str = ""
    """By the railway's own rules; nothing is presumed."""


class CodeTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Carriers and codes of a railway; the default has those of UM71 and ZPW-2000 without meanings."""

    carriers_hz: tuple[Frequency, ...] = (1700.0, 2000.0, 2300.0, 2600.0)
    carrier_offsets_hz: tuple[float, ...] = (0.0, 1.4, -1.3)
    """UM71 sends on the carrier itself, ZPW-2000 1.4 Hz above or 1.3 Hz below."""
    carrier_tolerance_hz: Annotated[float, Meta(gt=0.0, le=2.0)] = 0.4
    shift_hz: Frequency = 11.0
    """To either side of the carrier."""
    codes: tuple[Code, ...] = tuple(Code(hz=hz) for hz in CODES_HZ)
    code_tolerance_hz: Annotated[float, Meta(gt=0.0, le=0.5)] = 0.3

    def __post_init__(self) -> None:
        """Refuse tables in which two codes could be taken for each other, or that have none."""
        codes = sorted(code.hz for code in self.codes)
        if not codes or not self.carriers_hz:
            msg = "a code table needs carriers_hz and codes"
            raise ValueError(msg)
        if any(b - a < 2.0 * self.code_tolerance_hz for a, b in pairwise(codes)):
            msg = f"codes stand closer than twice code_tolerance_hz ({self.code_tolerance_hz:g} Hz)"
            raise ValueError(msg)

    def meaning_of(self, hz: float) -> str:
        """Meaning of the nearest code; empty when it has none."""
        return min(self.codes, key=lambda code: abs(code.hz - hz)).meaning


def table_for(profile: Profile, table: CodeTable) -> CodeTable:
    """`table` with carriers, shift and codes of a profile; meanings stay where the codes are the same."""
    known = {code.hz: code for code in table.codes}
    codes = tuple(known.get(hz, Code(hz=hz)) for hz in profile.tones_hz) or table.codes
    return msgspec.structs.replace(table, carriers_hz=profile.carriers_hz, shift_hz=profile.shift_hz, codes=codes)
