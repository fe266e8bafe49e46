"""What a track circuit sends: one struct, so that other carriers, chip rates, codes and framings are configuration."""

from __future__ import annotations

from typing import Annotated, Final, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

Scheme = Literal["ss-cdma", "cdma-qam", "fsk"]
Pulse = Literal["rectangular", "root-raised-cosine"]
Order = Literal[4, 16, 64]
Positive = Annotated[float, Meta(gt=0.0)]
Row = Annotated[int, Meta(ge=1, le=4096)]

QAM_CODES: Final = {4: 1, 16: 3, 64: 7}
"""Codes on each of I and Q by the order of the constellation: their sum has as many levels as a side has points."""


class ProfileError(ValueError):
    """A profile that contradicts itself; the message says which field and why."""


class PnGenerator(msgspec.Struct, frozen=True, kw_only=True):
    """A pseudo-noise sequence from a Fibonacci shift register: bit = parity of the tapped stages."""

    stages: Annotated[int, Meta(ge=2, le=31)] = 10
    taps: tuple[int, ...] = (10, 7)
    """Stages fed back, counted from 1. The default x^10 + x^7 + 1 is primitive: period 1023."""
    seed: Annotated[int, Meta(ge=1)] = 0b1001011011
    """Contents at the start, stage 1 in the lowest bit; never zero."""

    def bits(self, count: int) -> NDArray[np.int8]:
        """The first `count` bits, 0 or 1; one is given out by the last stage before each shift."""
        state = self.seed & ((1 << self.stages) - 1)
        if state == 0 or any(not 1 <= tap <= self.stages for tap in self.taps):
            msg = f"pilot generator: seed {self.seed} and taps {self.taps} do not fit {self.stages} stages"
            raise ProfileError(msg)
        found = np.empty(count, np.int8)
        for k in range(count):
            found[k] = (state >> (self.stages - 1)) & 1
            fed_back = 0
            for tap in self.taps:
                fed_back ^= (state >> (tap - 1)) & 1
            state = ((state << 1) | fed_back) & ((1 << self.stages) - 1)
        return found


class Framing(msgspec.Struct, frozen=True, kw_only=True):
    """How telegrams stand in the bits: preamble, circuit id, sequence, length, payload, check (telegram.py)."""

    preamble: Annotated[str, Meta(pattern="^[01]{8,64}$")] = "1111100110101"
    """Default: the Barker sequence of 13, whose shifted copies agree least with it."""
    preamble_errors: Annotated[int, Meta(ge=0, le=8)] = 1
    """Wrong bits that a preamble may have; the check decides afterwards."""
    longest_payload: Annotated[int, Meta(ge=0, le=255)] = 64
    """Bytes; a header that claims more is no telegram."""
    confirmations: Annotated[int, Meta(ge=1, le=4)] = 2
    """Telegrams in a row that must agree before one is acted upon."""


class Profile(msgspec.Struct, frozen=True, kw_only=True):
    """One track-circuit signal; the defaults are the standard profile (12 kHz, 4800 chip/s, 300 bit/s).

    Decodes from the `trackcircuit:profile` of a SigMF recording. Rows count from 1 in Sylvester's order.
    """

    scheme: Scheme = "ss-cdma"
    carrier_hz: Positive = 12_000.0
    chip_rate_hz: Positive = 4_800.0
    """Of CDMA-QAM: QAM symbols per second."""
    code_length: Annotated[int, Meta(ge=2, le=4096)] = 16
    ch1_row: Row = 2
    """Data. Row 2 alternates, which delay-and-add cancels (Arai et al., section 2)."""
    ch2_row: Row = 14
    """Training."""
    ch2_amplitude: Positive = 1.0
    """Of CH2 relative to CH1."""
    pilot_bits: Annotated[str, Meta(pattern="^[01]*$")] = ""
    """Bits of CH2 from its first symbol on, repeated when used up; empty: `pilot_generator`."""
    pilot_generator: PnGenerator = PnGenerator()
    pulse: Pulse = "rectangular"
    roll_off: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.35
    """Of root-raised-cosine chips."""
    framing: Framing | None = None
    """None: bits without telegrams."""
    qam_order: Order = 16
    """Of CDMA-QAM: points of the constellation; 4 levels on each of I and Q carry three codes, 8 levels seven."""
    qam_rows: tuple[Row, ...] = (1, 3, 5, 7, 9, 11, 13)
    """Codes of CDMA-QAM, on I and on Q alike, low sequency first; as many as the order needs are used."""
    qam_training: Annotated[int, Meta(ge=16, le=4096)] = 64
    """Known QAM symbols ahead of the data."""
    qam_blocks: Annotated[int, Meta(ge=0, le=65_536)] = 0
    """Blocks of data, each a code long, from one training to the next; 0: training comes once, the data go on."""
    carriers_hz: tuple[Positive, ...] = (1700.0, 2000.0, 2300.0, 2600.0)
    """Of FSK."""
    shift_hz: Positive = 11.0
    """Of FSK, to either side."""
    tones_hz: tuple[Positive, ...] = ()
    """Low-frequency codes of FSK; empty: the table of the receiver."""

    def __post_init__(self) -> None:
        """Raise ProfileError for rows beyond the code and codes that cannot exist."""
        if self.scheme == "fsk":
            return
        length = self.code_length
        if length & (length - 1):
            msg = f"code_length {length}: Walsh-Hadamard codes have a power of two"
            raise ProfileError(msg)
        for field, row in (("ch1_row", self.ch1_row), ("ch2_row", self.ch2_row)):
            if row > length:
                msg = f"{field} {row}: a code of {length} chips has rows 1 to {length}"
                raise ProfileError(msg)
        if self.ch1_row == self.ch2_row:
            msg = f"ch1_row and ch2_row are both {self.ch1_row}: the channels could not be told apart"
            raise ProfileError(msg)

    @property
    def bits_per_block(self) -> int:
        """Bits of data that one code length carries: one of CH1, or those of all codes on I and Q."""
        return 2 * QAM_CODES[self.qam_order] if self.scheme == "cdma-qam" else 1

    @property
    def symbol_rate_hz(self) -> float:
        """Code lengths per second: of SS-CDMA, bits of CH1."""
        return self.chip_rate_hz / self.code_length

    @property
    def bit_rate_hz(self) -> float:
        """Bits of data per second, training not counted."""
        return self.symbol_rate_hz * self.bits_per_block

    def pilots(self) -> NDArray[np.float64]:
        """One period of CH2's bits as +1 (bit 0) and -1 (bit 1)."""
        if self.pilot_bits:
            bits = np.frombuffer(self.pilot_bits.encode(), np.uint8).astype(np.int8) - np.int8(ord("0"))
        else:
            bits = self.pilot_generator.bits((1 << self.pilot_generator.stages) - 1)
        return 1.0 - 2.0 * bits.astype(np.float64)


def decode_profile(text: bytes | str) -> Profile:
    """A profile from JSON, such as `trackcircuit:profile` of a SigMF recording; fields it does not know are ignored.

    Raises ProfileError, which names the field.
    """
    try:
        return msgspec.json.decode(text, type=Profile)
    except msgspec.DecodeError as error:
        msg = f"track-circuit profile: {error}"
        raise ProfileError(msg) from error
