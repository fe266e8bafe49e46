"""Epochs as they come from real receivers: jumping clocks, wrong order, broken values, missing ephemerides."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.codec import decode, encode
from schemas.gnss import Ephemeris, Epoch, Fix, Ionosphere, Method, SatelliteVerdict
from services.gnss_correction.clock_jump import MILLISECOND_M
from services.gnss_correction.fix_messages import fixes_of
from services.gnss_correction.pipeline import Correction, block_of
from services.gnss_correction.settings import Config
from services.gnss_correction.solve_file import blocks
from services.gnss_correction.verdict_messages import verdicts_of
from services.gnss_receiver.observations import Observations, satellite_code
from services.numerics.geodesy import enu_about
from tests.unit.gnss_correction.made_up_sky import PLACE_DEG, START_S, WEEK, constellation, ephemeris, measured

GPS = constellation()
METHODS: tuple[Method, ...] = ("original", "remove", "adjust")


def informed(config: Config | None = None, ephemerides: list[Ephemeris] = GPS) -> Correction:
    correction = Correction(config or Config(method="adjust"), METHODS)
    for one in ephemerides:
        correction.add(one)
    return correction


def reflected(epoch: Epoch) -> int:
    """The satellite that recedes fastest: its changes do not pass through zero."""
    return int(np.argmin(epoch.doppler_hz))


def drive(epochs: int, *, jump_at: int | None = None, multipath_at: int | None = None) -> list[Epoch]:
    """A standing receiver at 5 Hz whose clock drifts, and may jump by a millisecond, and one reflected signal."""
    made = []
    for k in range(epochs):
        t_s = START_S + 0.2 * k
        jump_m = MILLISECOND_M if jump_at is not None and k >= jump_at else 0.0
        epoch = measured(GPS, t_s, clocks_m={"G": 20_000.0 + 30.0 * k + jump_m})
        if multipath_at is not None and k >= multipath_at:
            pseudorange = epoch.pseudorange_m.copy()
            pseudorange[reflected(epoch)] += 60.0
            epoch = msgspec.structs.replace(epoch, pseudorange_m=pseudorange)
        made.append(epoch)
    return made


def answers(correction: Correction, epochs: list[Epoch]) -> dict[Method, list[Fix]]:
    found: dict[Method, list[Fix]] = {method: [] for method in METHODS}
    for epoch in epochs:
        corrected = correction.epoch(epoch)
        for method in METHODS:
            found[method] += fixes_of(corrected, method)
    return found


def off_by_m(fix: Fix) -> float:
    assert fix.status == "fix", fix.reason
    return float(np.linalg.norm(enu_about(PLACE_DEG, fix.lat_deg or 0.0, fix.lon_deg or 0.0, fix.h_m or 0.0)))


def verdict_of(correction: Correction, epoch: Epoch, satellite: str) -> SatelliteVerdict:
    (verdicts,) = verdicts_of(correction.epoch(epoch))
    return next(one for one in verdicts.satellites if one.satellite == satellite)


def changed(epoch: Epoch, **columns: Any) -> Epoch:  # noqa: ANN401 - any column
    return msgspec.structs.replace(epoch, **columns)


def test_a_reflected_signal_is_flagged_removed_and_adjusted() -> None:
    found = answers(informed(), drive(20, multipath_at=12))
    assert [fix.satellites_flagged for fix in found["adjust"]] == [0] * 12 + [1] * 6 + [0] * 2
    for k in range(12):
        assert off_by_m(found["adjust"][k]) < 0.01
    assert off_by_m(found["original"][12]) > 5.0
    # The clock of the made-up drive drifts by 30 m per epoch, steadily: the substitute is exact at first.
    assert off_by_m(found["adjust"][12]) < 0.01
    assert off_by_m(found["remove"][12]) < 0.01
    assert found["remove"][12].satellites_used == found["original"][12].satellites_used - 1
    assert off_by_m(found["adjust"][19]) == pytest.approx(off_by_m(found["original"][19]), abs=1e-3)


def test_verdicts_say_what_was_done() -> None:
    epochs = drive(13, multipath_at=12)
    name = epochs[0].satellites[reflected(epochs[0])]
    words = {}
    for method in METHODS:
        correction = informed(Config(method=method))
        for epoch in epochs[:-1]:
            correction.epoch(epoch)
        words[method] = verdict_of(correction, epochs[-1], name)
    # The range rate itself changes by some centimetres per second within the mean's second.
    found = "change 60.01 m per 0.2 s over the threshold of 0.45 m"
    told = {method: one.reason.partition("; probably reflected: ") for method, one in words.items()}
    assert {method: parts[0] for method, parts in told.items()} == {
        "original": found,
        "remove": f"{found}, left out",
        "adjust": f"{found}, adjusted by -60.0 m",
    }
    residuals_m = [float(parts[2].split(" m off the other satellites")[0]) for parts in told.values()]
    assert min(residuals_m) > 5.0, "what is left of 60 m after it moved the place"
    assert [words[method].used for method in METHODS] == [True, False, True]
    assert words["adjust"].adjusted_by_m == pytest.approx(-60.0, abs=0.05)
    assert words["adjust"].change_m == pytest.approx(60.0, abs=0.05)
    assert words["remove"].residual_m == pytest.approx(60.0, abs=0.1), "against the fix without it"
    assert all(one.flagged for one in words.values())


@pytest.mark.parametrize("doppler", [True, False])
def test_a_millisecond_of_clock_makes_no_difference(doppler: bool) -> None:  # noqa: FBT001 - a parameter of the test
    def run(jump_at: int | None) -> tuple[Correction, dict[Method, list[Fix]]]:
        correction = informed()
        epochs = drive(20, jump_at=jump_at, multipath_at=14)
        if not doppler:
            epochs = [changed(one, doppler_hz=np.full(len(one.satellites), np.nan)) for one in epochs]
        return correction, answers(correction, epochs)

    (_, still), (correction, jumped) = run(None), run(8)
    assert correction.detector.clock_jumps == 1
    for method in METHODS:
        for before, after in zip(still[method], jumped[method], strict=True):
            assert after.satellites_flagged == before.satellites_flagged
            # Convergence to 0.1 mm, and rounding of changes of 3e5 m over 0.2 s.
            assert off_by_m(after) == pytest.approx(off_by_m(before), abs=1e-3)


def test_epochs_and_blocks_give_the_same() -> None:
    epochs = drive(30, jump_at=8, multipath_at=14)
    parts = [block_of(epoch) for epoch in epochs]
    first = np.cumsum([0] + [len(part.satellite) for part in parts])

    def joined(name: str) -> Any:  # noqa: ANN401 - any column
        return np.concatenate([getattr(part, name) for part in parts])

    columns = ("satellite", "signal", "pseudorange_m", "carrier_phase_cycles", "doppler_hz", "cn0_dbhz", "lock_lost")
    whole = Observations(
        gps_week=joined("gps_week"),
        tow_s=joined("tow_s"),
        first_row=first.astype(np.int64),
        signals=parts[0].signals,
        **{name: joined(name) for name in columns},
    )
    corrected = informed().block(whole)
    assert [len(part) for part in blocks(whole)] == [30]
    single = informed()
    for k, epoch in enumerate(epochs):
        one = single.epoch(epoch)
        for method in METHODS:
            (fix,) = fixes_of(one, method)
            assert msgspec.structs.replace(fixes_of(corrected, method)[k], t_ns=0) == msgspec.structs.replace(
                fix, t_ns=0
            )
        assert verdicts_of(corrected)[k].satellites == verdicts_of(one)[0].satellites


def test_repeated_and_late_epochs_are_answered_and_change_nothing() -> None:
    epochs = drive(16)
    plain = answers(informed(), epochs)["adjust"]
    shuffled = [*epochs[:10], epochs[9], epochs[4], *epochs[10:]]
    mixed = answers(informed(), shuffled)["adjust"]
    assert [fix.status for fix in mixed] == ["fix"] * 10 + ["none"] * 2 + ["fix"] * 6
    assert mixed[10].reason == "epoch repeated"
    assert mixed[11].reason.startswith("epoch steps back by 1.0")
    assert [*mixed[:10], *mixed[12:]] == plain


def test_a_missing_stretch_starts_the_detector_anew() -> None:
    epochs = drive(40)
    correction = informed()
    answers(correction, epochs[:10])
    after = verdict_of(correction, epochs[30], epochs[30].satellites[0])
    assert after.reason == "watched for 0 of 5 epochs"
    assert after.change_m is None
    assert after.used


def test_an_empty_epoch_is_answered() -> None:
    epoch = measured(GPS, START_S, lowest_rad=2.0)
    assert epoch.satellites == ()
    found = answers(informed(), [epoch])
    assert {fix.reason for fixes in found.values() for fix in fixes} == {"0 usable of 0 satellites, 4 needed"}


@pytest.mark.parametrize("tow_s", [math.nan, math.inf, -1.0, 1e9])
def test_an_epoch_without_a_time_is_answered_at_its_time_of_measurement(tow_s: float) -> None:
    epoch = drive(1)[0]
    (fix,) = fixes_of(informed().epoch(changed(epoch, tow_s=tow_s)), "adjust")
    assert fix.status == "none"
    assert fix.reason.startswith("absurd epoch time")
    assert math.isfinite(fix.tow_s)
    if not math.isfinite(tow_s):
        assert fix.gps_week == epoch.gps_week
        assert fix.tow_s == pytest.approx(epoch.tow_s)


@pytest.mark.parametrize(
    ("value_m", "reason"),
    [
        (math.nan, "no pseudorange"),
        (1e12, "absurd pseudorange of 1e+12 m"),
        (-2.3e7, "absurd pseudorange of -2.3e+07 m"),
        (0.0, "absurd pseudorange of 0 m"),
        (math.inf, "absurd pseudorange of inf m"),
    ],
)
def test_broken_pseudoranges_are_left_out_with_a_reason(value_m: float, reason: str) -> None:
    epoch = drive(1)[0]
    pseudorange = epoch.pseudorange_m.copy()
    pseudorange[2] = value_m
    broken = changed(epoch, pseudorange_m=pseudorange)
    one = verdict_of(informed(), broken, epoch.satellites[2])
    assert (one.used, one.reason, one.residual_m) == (False, reason, None)
    (fix,) = fixes_of(informed().epoch(broken), "original")
    assert fix.satellites_used == len(epoch.satellites) - 1
    assert off_by_m(fix) < 0.01


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        (None, "no ephemeris"),
        ({"healthy": False}, "unhealthy"),
        ({"toe_s": START_S - 9_000.0}, "ephemeris stale by 1800 s"),
        ({"orbit": msgspec.structs.replace(GPS[0].orbit, sqrt_a=0.0)}, "ephemeris gives no orbit"),
        ({"orbit": msgspec.structs.replace(GPS[0].orbit, eccentricity=math.nan)}, "ephemeris gives no orbit"),
    ],
)
def test_a_satellite_without_a_good_ephemeris_is_left_out(changes: dict[str, Any] | None, reason: str) -> None:
    epoch = measured(GPS, START_S)
    name = epoch.satellites[2]
    others = [one for one in GPS if one.satellite != name]
    mine = [] if changes is None else [ephemeris(name, **changes)]
    correction = informed(ephemerides=others + mine)
    one = verdict_of(correction, epoch, name)
    assert (one.used, one.reason) == (False, reason)
    (fix,) = fixes_of(informed(ephemerides=others + mine).epoch(epoch), "original")
    assert off_by_m(fix) < 0.01


def test_without_any_ephemeris_the_reason_says_so() -> None:
    epoch = measured(GPS, START_S)
    (fix,) = fixes_of(Correction(Config()).epoch(epoch), "robust")
    count = len(epoch.satellites)
    assert fix.reason == f"0 usable of {count} satellites, 4 needed ({count} no ephemeris)"


def test_only_selected_systems_take_part() -> None:
    everything = GPS + constellation("E", 24)
    epoch = measured(everything, START_S)
    (verdicts,) = verdicts_of(informed(Config(method="adjust", systems="E"), everything).epoch(epoch))
    assert {one.satellite[0] for one in verdicts.satellites} == {"E"}


def test_of_several_signals_the_preferred_one_with_a_pseudorange_counts() -> None:
    epoch = measured(GPS, START_S)
    count = len(epoch.satellites)
    doubled = changed(
        epoch,
        satellites=epoch.satellites * 2,
        signals=("2W",) * count + ("1C",) * count,
        pseudorange_m=np.concatenate([epoch.pseudorange_m + 9.0, epoch.pseudorange_m]),
        carrier_phase_cycles=np.full(2 * count, np.nan),
        doppler_hz=np.tile(epoch.doppler_hz, 2),
        cn0_dbhz=np.tile(epoch.cn0_dbhz, 2),
        lock_lost=np.zeros(2 * count, np.uint8),
    )
    corrected = informed().epoch(doubled)
    (fix,) = fixes_of(corrected, "original")
    assert off_by_m(fix) < 0.01
    other = changed(epoch, signals=("2W",) * count)
    assert verdict_of(informed(), other, epoch.satellites[0]).reason == "no L1, E1 or B1I signal"


def test_the_ionosphere_that_was_broadcast_is_used() -> None:
    epoch = measured(GPS, START_S)
    correction = informed()
    correction.add(Ionosphere(t_ns=0, alpha=(5e-8, 0.0, 0.0, 0.0), beta=(2e5, 0.0, 0.0, 0.0)))
    (fix,) = fixes_of(correction.epoch(epoch), "original")
    assert off_by_m(fix) > 1.0, "the made-up measurements have only the night's ionosphere"


COLUMN = st.one_of(st.floats(), st.floats(1.9e7, 2.6e7), st.just(math.nan))


@given(data=st.data())
@settings(max_examples=40)
def test_whatever_comes_every_epoch_is_answered_and_can_travel(data: st.DataObject) -> None:
    correction = informed()
    for _ in range(data.draw(st.integers(1, 6))):
        names = data.draw(
            st.lists(st.sampled_from(["G01", "G02", "G03", "G07", "G12", "E04", "S20", "R05"]), max_size=9)
        )
        count = len(names)

        def column(values: st.SearchStrategy[float], count: int = count) -> Any:  # noqa: ANN401 - an array
            return np.array(data.draw(st.lists(values, min_size=count, max_size=count)), np.float64)

        epoch = Epoch(
            t_ns=data.draw(st.integers(10**18, 2 * 10**18)),
            gps_week=data.draw(st.integers(-5, 12_000)),
            tow_s=data.draw(st.one_of(st.floats(), st.floats(START_S, START_S + 5.0))),
            satellites=tuple(names),
            signals=tuple(data.draw(st.sampled_from(["1C", "2W", "2I"])) for _ in names),
            pseudorange_m=column(COLUMN),
            carrier_phase_cycles=column(COLUMN),
            doppler_hz=column(COLUMN),
            cn0_dbhz=column(st.floats()),
            lock_lost=np.zeros(count, np.uint8),
        )
        corrected = correction.epoch(epoch)
        (verdicts,) = verdicts_of(corrected)
        assert b"NaN" not in msgspec.json.encode(verdicts)
        assert [one.satellite for one in verdicts.satellites] == sorted(
            {name for name in names if name[0] in "GRECJ"}, key=satellite_code
        )
        for method in METHODS:
            (fix,) = fixes_of(corrected, method)
            assert decode(Fix, encode(fix)) == fix
            assert fix.reason or fix.status == "fix"
            assert all(math.isfinite(v) for v in msgspec.structs.astuple(fix) if isinstance(v, float))


def test_weeks_of_other_epochs_are_counted_from_the_ephemerides() -> None:
    over = [ephemeris(one.satellite, one.orbit, gps_week=WEEK, toe_s=604_000.0, toc_s=604_000.0) for one in GPS]
    epoch = measured(over, 604_800.0 + 100.0)
    wrapped = changed(epoch, gps_week=WEEK + 1, tow_s=epoch.tow_s - 604_800.0)
    (fix,) = fixes_of(informed(ephemerides=over).epoch(wrapped), "original")
    assert off_by_m(fix) < 0.01
