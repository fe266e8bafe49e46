"""The detector of Yoshinaga et al. 2008, on pseudoranges whose changes are known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.gnss_correction.clock_jump import MILLISECOND_M
from services.gnss_correction.multipath import Judgement, MultipathDetector, Sight
from services.gnss_correction.settings import Config

HIGH_RAD = 1.0
FAR_M = 2.2e7


def judge_all(
    pseudoranges_m: Sequence[float],
    *,
    config: Config | None = None,
    intervals_s: Sequence[float] | None = None,
    elevation_rad: float = HIGH_RAD,
    signals: Sequence[int] | None = None,
) -> list[Judgement]:
    """Judgements of one satellite's pseudoranges, 0.2 s apart unless said."""
    detector = MultipathDetector(config or Config())
    times_s = [0.0, *accumulate(intervals_s or [0.2] * (len(pseudoranges_m) - 1))]
    judged = []
    for k, (t_s, pseudorange_m) in enumerate(zip(times_s, pseudoranges_m, strict=True)):
        sight = Sight(5, signals[k] if signals else 0, pseudorange_m, math.nan, elevation_rad)
        judged += detector.judge(t_s, [sight])
    return judged


def moving(rate_mps: float, steps_m: dict[int, float], epochs: int = 20) -> list[float]:
    """Pseudoranges every 0.2 s that change at a steady rate, with steps at some epochs."""
    return [FAR_M + rate_mps * 0.2 * k + sum(step for at, step in steps_m.items() if k >= at) for k in range(epochs)]


def substitute_m(judged: Judgement) -> float | None:
    """Pseudorange that was to be expected, where one may be substituted."""
    return judged.substitute.pseudorange_m if judged.substitute else None


def flags(judged: Sequence[Judgement]) -> list[int]:
    return [k for k, one in enumerate(judged) if one.flagged]


def test_it_judges_once_five_changes_are_known() -> None:
    judged = judge_all(moving(300.0, {}))
    assert [one.watched_epochs for one in judged[:8]] == [0, 0, 1, 2, 3, 4, 5, 5]
    assert [one.change_m is None for one in judged[:8]] == [True] * 6 + [False] * 2


@given(
    rate_mps=st.floats(-900.0, 900.0),
    intervals_s=st.lists(st.sampled_from([0.1, 0.2, 0.3, 1.0]), min_size=12, max_size=12),
)
def test_a_steady_rate_is_clean_whatever_the_intervals(rate_mps: float, intervals_s: list[float]) -> None:
    times_s = [0.0, *accumulate(intervals_s)]
    judged = judge_all([FAR_M + rate_mps * t for t in times_s], intervals_s=intervals_s)
    assert flags(judged) == []
    # Rounding of 2e7 m over the shortest interval.
    assert all(one.change_m == pytest.approx(0.0, abs=1e-7) for one in judged[6:])


def test_pc_is_the_difference_from_the_mean_of_the_five_before() -> None:
    changes_m = [60.0, 61.0, 62.0, 63.0, 64.0, 70.0, 65.0]
    judged = judge_all([FAR_M, *(FAR_M + total for total in accumulate(changes_m))])
    assert judged[6].change_m == pytest.approx(70.0 - 62.0, abs=1e-6)
    assert judged[7].change_m == pytest.approx(abs(65.0 - (61.0 + 62.0 + 63.0 + 64.0 + 70.0) / 5), abs=1e-6)
    assert judged[6].threshold_m == 0.45


def test_the_current_change_may_be_in_the_mean() -> None:
    changes_m = [60.0, 61.0, 62.0, 63.0, 64.0, 70.0]
    judged = judge_all(
        [FAR_M, *(FAR_M + total for total in accumulate(changes_m))], config=Config(mean_includes_current=True)
    )
    assert judged[5].change_m == pytest.approx(64.0 - 62.0, abs=1e-6)
    assert judged[6].change_m == pytest.approx(70.0 - (61.0 + 62.0 + 63.0 + 64.0 + 70.0) / 5, abs=1e-6)


@pytest.mark.parametrize(("step_m", "flagged"), [(0.44, False), (0.46, True), (-0.44, False), (-0.46, True)])
def test_the_threshold_is_045_m_per_02_s(step_m: float, flagged: bool) -> None:  # noqa: FBT001 - a parameter of the test
    assert judge_all(moving(300.0, {10: step_m}))[10].flagged is flagged


@pytest.mark.parametrize(("step_m", "flagged"), [(2.2, False), (2.3, True)])
def test_the_threshold_goes_with_the_interval(step_m: float, flagged: bool) -> None:  # noqa: FBT001 - a parameter of the test
    pseudoranges_m = [FAR_M + 300.0 * k + (step_m if k >= 10 else 0.0) for k in range(14)]
    judged = judge_all(pseudoranges_m, intervals_s=[1.0] * 13)
    assert judged[10].flagged is flagged


@pytest.mark.parametrize(("elevation_deg", "threshold_m"), [(9.9, 0.75), (10.0, 0.45), (math.nan, 0.45)])
def test_near_the_horizon_it_is_03_m_higher(elevation_deg: float, threshold_m: float) -> None:
    judged = judge_all(moving(300.0, {}), elevation_rad=math.radians(elevation_deg))
    assert judged[10].threshold_m == pytest.approx(threshold_m)


def test_the_end_of_a_stretch_is_noticed() -> None:
    judged = judge_all(moving(300.0, {10: 50.0}, 30))
    # The step stays in the mean of the next five changes, then it is gone.
    assert flags(judged) == [10, 11, 12, 13, 14, 15]


@pytest.mark.parametrize("rate_mps", [300.0, -300.0])
def test_the_substitute_follows_the_signed_rate(rate_mps: float) -> None:
    pseudoranges_m = moving(rate_mps, {10: 50.0}, 12)
    judged = judge_all(pseudoranges_m)
    expected_m = pseudoranges_m[9] + rate_mps * 0.2
    assert substitute_m(judged[10]) == pytest.approx(expected_m, abs=1e-6)
    # The next goes on from the substitute by the mean that has taken in the step.
    mean_mps = (4 * rate_mps + (rate_mps + 250.0)) / 5
    assert substitute_m(judged[11]) == pytest.approx(expected_m + mean_mps * 0.2, abs=1e-6)


@pytest.mark.parametrize("doppler", [True, False])
def test_doppler_and_carrier_are_substituted_with_the_pseudorange(doppler: bool) -> None:  # noqa: FBT001 - a parameter of the test
    detector, rate_mps, judged = MultipathDetector(Config()), 300.0, []
    pseudoranges_m = moving(rate_mps, {10: 50.0}, 12)
    for k, pseudorange_m in enumerate(pseudoranges_m):
        # Once reflected, Doppler and carrier go astray as well.
        doppler_mps = (rate_mps if k < 10 else rate_mps + 40.0) if doppler else math.nan
        carrier_m = 7.0 + rate_mps * 0.2 * k + (900.0 if k >= 10 else 0.0)
        judged += detector.judge(0.2 * k, [Sight(5, 0, pseudorange_m, doppler_mps, HIGH_RAD, carrier_m)])
    first, second = judged[10].substitute, judged[11].substitute
    assert first is not None
    assert second is not None
    assert first.range_rate_mps == pytest.approx(rate_mps, abs=1e-6)
    assert first.carrier_m == pytest.approx(7.0 + rate_mps * 2.0, abs=1e-6)
    # The next goes on from the substituted carrier by the mean that has taken in the astray rate.
    astray_mps = rate_mps + (40.0 if doppler else 250.0) / 5
    assert second.range_rate_mps == pytest.approx(astray_mps, abs=1e-6)
    assert second.carrier_m == pytest.approx(first.carrier_m + astray_mps * 0.2, abs=1e-6)


def test_without_a_carrier_none_is_made_up() -> None:
    substitute = judge_all(moving(300.0, {10: 50.0}, 12))[10].substitute
    assert substitute is not None
    assert math.isnan(substitute.carrier_m)


def test_substituting_has_an_end() -> None:
    restless = [FAR_M + 5.0 * (k % 2) * k for k in range(40)]
    judged = judge_all(restless, config=Config(longest_adjusting_s=1.0))
    flagged = flags(judged)
    assert flagged == list(range(6, 40))
    assert [k for k in flagged if judged[k].substitute is not None] == list(range(6, 11))


def test_an_unflagged_epoch_begins_the_time_of_substituting_anew() -> None:
    judged = judge_all(moving(300.0, {10: 50.0, 20: 50.0}, 30), config=Config(longest_adjusting_s=1.3))
    assert [k for k, one in enumerate(judged) if one.substitute is not None] == [*range(10, 16), *range(20, 26)]


@pytest.mark.parametrize(("gap_s", "watched"), [(1.0, 5), (1.1, 0)])
def test_short_gaps_are_bridged_and_long_ones_are_not(gap_s: float, watched: int) -> None:
    intervals_s = [0.2] * 9 + [gap_s] + [0.2] * 3
    times_s = [0.0, *accumulate(intervals_s)]
    judged = judge_all([FAR_M + 300.0 * t for t in times_s], intervals_s=intervals_s, config=Config(longest_gap_s=1.05))
    assert judged[10].watched_epochs == watched
    assert flags(judged) == []


def test_another_signal_is_watched_from_anew() -> None:
    judged = judge_all(moving(300.0, {10: 7.0}), signals=[0] * 10 + [1] * 10)
    assert judged[10].watched_epochs == 0
    assert flags(judged) == []


RATES_MPS = (700.0, -650.0, 10.0, 200.0, -3.0)


def with_clock(
    jump_ms: int, *, doppler: bool, missing: frozenset[int] = frozenset(), nominal: bool = False
) -> list[list[Judgement]]:
    """Five satellites at 5 Hz, one reflected from epoch 13 on, the clock jumping before epoch 12.

    The stamps jump with the clock; on `nominal` stamps the receiver measures that much earlier instead.
    Satellite 4 is away at the epochs `missing`.
    """
    detector, judged = MultipathDetector(Config()), []
    for k in range(25):
        jumped_s = jump_ms * 1e-3 if k >= 12 else 0.0
        true_s, stamp_s = (0.2 * k - jumped_s, 0.2 * k) if nominal else (0.2 * k, 0.2 * k + jumped_s)
        sights = [
            Sight(
                number,
                0,
                FAR_M + rate_mps * true_s + jumped_s * 1e3 * MILLISECOND_M + (30.0 if number == 3 and k >= 13 else 0.0),
                rate_mps if doppler else math.nan,
                HIGH_RAD,
            )
            for number, rate_mps in enumerate(RATES_MPS)
            if not (number == 4 and k in missing)
        ]
        judged.append(detector.judge(stamp_s, sights))
    assert detector.clock_jumps == (jump_ms != 0)
    return judged


@pytest.mark.parametrize("doppler", [True, False])
@pytest.mark.parametrize("nominal", [True, False])
@pytest.mark.parametrize("missing", [frozenset(), frozenset({12}), frozenset({11, 12, 13})])
@pytest.mark.parametrize("jump_ms", [1, -1, 3])
def test_a_jump_of_the_clock_changes_nothing(
    jump_ms: int,
    missing: frozenset[int],
    nominal: bool,  # noqa: FBT001 - a parameter of the test
    doppler: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    still = with_clock(0, doppler=doppler, missing=missing)
    jumped = with_clock(jump_ms, doppler=doppler, missing=missing, nominal=nominal)
    assert any(one.flagged for epoch in still for one in epoch)
    for before, after in zip(still, jumped, strict=True):
        assert [one.flagged for one in after] == [one.flagged for one in before]
        # Rounding of 2e7 m over 0.2 s.
        assert [one.change_m for one in after] == pytest.approx([one.change_m for one in before], abs=1e-6)
        assert [one.substitute is None for one in after] == [one.substitute is None for one in before]


def test_stamps_that_jump_further_than_time_goes_on_begin_anew() -> None:
    detector = MultipathDetector(Config())
    for k in range(8):
        detector.judge(0.2 * k, [Sight(n, 0, FAR_M, 0.0, HIGH_RAD) for n in range(3)])
    judged = detector.judge(1.6, [Sight(n, 0, FAR_M + 300 * MILLISECOND_M, 0.0, HIGH_RAD) for n in range(3)])
    assert [one.watched_epochs for one in judged] == [0, 0, 0]


def test_the_substitute_jumps_with_the_clock() -> None:
    detector, substitutes = MultipathDetector(Config()), []
    for k in range(14):
        jump_m = MILLISECOND_M if k >= 11 else 0.0
        sights = [Sight(n, 0, FAR_M + jump_m + (50.0 if n == 0 and k >= 10 else 0.0), 0.0, HIGH_RAD) for n in range(4)]
        substitutes.append(substitute_m(detector.judge(0.2 * k, sights)[0]))
    assert substitutes[10] == pytest.approx(FAR_M, abs=1e-6)
    # One fifth of the step is in the mean by now; on unmoved stamps the receiver measures a millisecond earlier.
    assert substitutes[11] == pytest.approx(FAR_M + MILLISECOND_M + 10.0 * 0.199 / 0.2, abs=1e-6)


def test_a_drifting_clock_is_no_multipath() -> None:
    # 3 ppm of drift are 180 m per epoch, in every change and in every mean alike.
    assert flags(judge_all(moving(300.0 + 900.0, {}))) == []


def test_time_that_steps_back_begins_anew() -> None:
    detector = MultipathDetector(Config())
    for k in range(10):
        detector.judge(100.0 + 0.2 * k, [Sight(1, 0, FAR_M + k, math.nan, HIGH_RAD)])
    (back,) = detector.judge(50.0, [Sight(1, 0, FAR_M, math.nan, HIGH_RAD)])
    (again,) = detector.judge(50.2, [Sight(1, 0, FAR_M, math.nan, HIGH_RAD)])
    assert (back.watched_epochs, again.watched_epochs) == (0, 0)


@given(
    changes_m=st.lists(st.floats(-100.0, 100.0), min_size=7, max_size=30),
    intervals_s=st.lists(st.sampled_from([0.2, 0.3]), min_size=30, max_size=30),
)
def test_flags_and_substitutes_agree(changes_m: list[float], intervals_s: list[float]) -> None:
    judged = judge_all(
        [FAR_M, *(FAR_M + total for total in accumulate(changes_m))], intervals_s=intervals_s[: len(changes_m)]
    )
    for one in judged:
        if one.change_m is None or one.threshold_m is None:
            assert not one.flagged
            continue
        assert one.flagged == (one.change_m > one.threshold_m)
        assert (one.substitute is not None) == one.flagged
