"""Galileo's F/NAV and BeiDou's D2 out of UBX: bits written by the documents come back as the ephemeris."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import pytest

from schemas.gnss import Ephemeris, KeplerOrbit
from services.gnss_receiver.beidou_geo_subframes import BeidouGeoCollector
from services.gnss_receiver.fnav_pages import FnavCollector
from services.gnss_receiver.receiver_stream import ReceiverStream
from tests.unit.gnss_receiver.broadcast_samples import inav_pages, kepler, lnav_subframes
from tests.unit.gnss_receiver.page_samples import beidou_pages, fnav_pages
from tests.unit.gnss_receiver.stream_samples import TOW_S, WEEK, listen, rawx, sfrbx

NEAR_S = WEEK * 604_800 + TOW_S
GALILEO, BEIDOU = 2, 3
E5A, E1, B1I_D2, B2I_D2, B3I_D2 = 3, 1, 1, 3, 10
ROW = [(0, 10, 0, 20_576_396.77, 108_129_693.934, 1064.326, 64_500, 51, 7)]


def same(found: Ephemeris, wanted: Ephemeris) -> None:
    """Equal in every figure: all are whole numbers of steps, so that only the last bit of a float may differ."""
    assert isinstance(found.orbit, KeplerOrbit)
    assert isinstance(wanted.orbit, KeplerOrbit)
    for name in KeplerOrbit.__struct_fields__:
        assert getattr(found.orbit, name) == pytest.approx(getattr(wanted.orbit, name), rel=1e-15), name
    for name in ("clock_bias_s", "clock_drift", "clock_drift_rate_per_s", "group_delay_s"):
        assert getattr(found, name) == pytest.approx(getattr(wanted, name), rel=1e-15), name
    for name in ("satellite", "gps_week", "toe_s", "toc_s", "issue", "healthy", "accuracy_m", "fit_interval_s"):
        assert getattr(found, name) == getattr(wanted, name), name


@dataclass(frozen=True)
class Kind:
    """A message in pages: who sends it, and how."""

    satellite: str
    system: int
    signal: int
    pages: list[list[int]]

    @property
    def stream(self) -> bytes:
        return rawx(ROW) + b"".join(sfrbx(self.system, int(self.satellite[1:]), self.signal, one) for one in self.pages)


KINDS = [
    Kind("E19", GALILEO, E5A, fnav_pages(kepler("E19"))),
    Kind("C03", BEIDOU, B1I_D2, beidou_pages(kepler("C03"))),
    Kind("C60", BEIDOU, B2I_D2, beidou_pages(kepler("C60"))),
    Kind("C05", BEIDOU, B3I_D2, beidou_pages(kepler("C05"))),
]


def ephemerides(stream: bytes) -> tuple[list[Ephemeris], ReceiverStream]:
    heard, receiver = listen(stream)
    return [one for one in heard if isinstance(one, Ephemeris)], receiver


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: f"{kind.satellite}_{kind.signal}")
def test_pages_come_back_as_the_ephemeris(kind: Kind) -> None:
    (found,), receiver = ephemerides(kind.stream + kind.stream)
    same(found, kepler(kind.satellite))
    assert not [name for name in receiver.counts if name.startswith(("bad_", "unsupported_"))]


@pytest.mark.parametrize("kind", KINDS[:2], ids=["F/NAV", "D2"])
def test_one_wrong_bit_in_a_page_refuses_it(kind: Kind) -> None:
    damaged = [list(words) for words in kind.pages]
    damaged[3][1] ^= 1 << 12
    (*found,), receiver = ephemerides(Kind(kind.satellite, kind.system, kind.signal, damaged).stream)
    assert found == []
    assert receiver.counts["bad_ubx_RXM-SFRBX"] == 1


@pytest.mark.parametrize("kind", KINDS[:2], ids=["F/NAV", "D2"])
@pytest.mark.parametrize("healthy", [True, False])
def test_health_is_read(kind: Kind, healthy: bool) -> None:  # noqa: FBT001 - a table of cases
    make = fnav_pages if kind.system == GALILEO else beidou_pages
    pages = make(kepler(kind.satellite, healthy=healthy))
    (found,), _ = ephemerides(Kind(kind.satellite, kind.system, kind.signal, pages).stream)
    assert found.healthy == healthy


def test_pages_of_two_issues_make_no_ephemeris() -> None:
    collector = FnavCollector()
    older, newer = kepler("E19"), msgspec.structs.replace(kepler("E19", toe_s=454_200.0), issue=22)
    for words in (*fnav_pages(older)[:2], *fnav_pages(newer)[2:]):
        assert collector.add(19, words, NEAR_S) is None
    # Now the newer one is whole; page 1 comes first, then page 2 completes it.
    assert collector.add(19, fnav_pages(newer)[0], NEAR_S) is None
    found = collector.add(19, fnav_pages(newer)[1], NEAR_S)
    assert found is not None
    same(found, newer)


def test_pages_that_do_not_follow_each_other_make_no_ephemeris() -> None:
    collector = BeidouGeoCollector()
    first, later = beidou_pages(kepler("C03")), beidou_pages(kepler("C03"), sow_s=455_430)
    for words in (*first[:6], *later[6:]):
        assert collector.add(3, words, NEAR_S) is None
    found = [collector.add(3, words, NEAR_S) for words in later]
    assert [one is None for one in found] == [True] * 5 + [False] + [True] * 4


def test_any_order_of_pages_will_do() -> None:
    collector = BeidouGeoCollector()
    pages = beidou_pages(kepler("C03"))
    found = [collector.add(3, words, NEAR_S) for words in (*pages[4:], *pages[:4])]
    assert found[-1] is not None
    same(found[-1], kepler("C03"))
    assert found[:-1] == [None] * 9


def test_figures_at_the_end_of_their_range_are_read() -> None:
    ephemeris = kepler("C03")
    assert isinstance(ephemeris.orbit, KeplerOrbit)
    smallest = -(2**31) * 2.0**-31 * math.pi
    orbit = msgspec.structs.replace(ephemeris.orbit, m0_rad=smallest, omega_rad=smallest, cuc_rad=-(2**17) * 2.0**-31)
    wanted = msgspec.structs.replace(ephemeris, orbit=orbit, clock_drift=-(2**21) * 2.0**-50)
    collector = BeidouGeoCollector()
    found = [one for words in beidou_pages(wanted) if (one := collector.add(3, words, NEAR_S)) is not None]
    same(found[0], wanted)


def test_inav_goes_before_fnav() -> None:
    inav = b"".join(sfrbx(GALILEO, 19, E1, words) for words in inav_pages(kepler("E19")))
    other = msgspec.structs.replace(kepler("E19"), clock_bias_s=kepler("E19").clock_bias_s + 2.0**-34)
    fnav = Kind("E19", GALILEO, E5A, fnav_pages(other)).stream
    found, receiver = ephemerides(inav + fnav)
    assert [one.clock_bias_s for one in found] == [kepler("E19").clock_bias_s]
    assert receiver.counts["fnav_left_out"] == 1
    # The other way round the clock for E1 follows, though orbit and issue are the same.
    found, _ = ephemerides(fnav + inav)
    assert [one.clock_bias_s for one in found] == [other.clock_bias_s, kepler("E19").clock_bias_s]


def test_d1_is_not_taken_for_d2() -> None:
    pages = beidou_pages(kepler("C30"))
    found, receiver = ephemerides(Kind("C30", BEIDOU, B1I_D2, pages).stream)
    assert found == []
    assert receiver.counts["unsupported_ubx_C_D2_of_no_GEO"] == 10


@pytest.mark.parametrize(
    ("system", "satellite", "signal", "name"),
    [
        (0, 5, 4, "G_CNAV"),
        (0, 5, 6, "G_CNAV"),
        (5, 2, 8, "J_CNAV"),
        (5, 2, 1, "J_L1S"),
        (2, 7, 8, "E_CNAV"),
        (3, 30, 6, "C_CNAV1"),
        (3, 30, 8, "C_CNAV2"),
        (3, 3, 0, "C_D1_of_GEO"),
        (1, 133, 0, "S_SBAS"),
        (7, 2, 0, "I_NavIC"),
        (6, 9, 5, "R_signal_5"),
        (4, 1, 0, "?_signal_0"),
    ],
)
def test_what_is_not_decoded_is_counted_by_its_name(system: int, satellite: int, signal: int, name: str) -> None:
    found, receiver = ephemerides(sfrbx(system, satellite, signal, lnav_subframes(kepler("G05"))[0]))
    assert found == []
    assert receiver.counts[f"unsupported_ubx_{name}"] == 1
