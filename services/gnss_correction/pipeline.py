"""From epochs to fixes and verdicts: the one path for files and for the live service.

Each epoch is solved from all its pseudoranges first, because the detector wants elevations;
then judged; then solved again without (`remove`) or with substituted pseudoranges (`adjust`)
of the satellites held for multipath; `robust` filters all of them instead, `line` along a known line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from schemas.gnss import Corrections, Ephemeris, Epoch, Ionosphere, Method
from schemas.gnss_time import WEEK_S, gps_from_unix_ns, unix_ns_from_gps
from schemas.thresholds import Thresholds
from services.gnss_correction.carrier_smoothing import CarrierSmoother
from services.gnss_correction.differential import CorrectionTable, add_corrections
from services.gnss_correction.ephemeris_store import EphemerisStore
from services.gnss_correction.epoch_order import EpochOrder
from services.gnss_correction.fix_messages import Corrected, Solution
from services.gnss_correction.line_method import Line, LineInput, LineMethod, LinePlacing
from services.gnss_correction.multipath import Judgement, MultipathDetector, Sight
from services.gnss_correction.multipath_evidence import EvidenceGatherer
from services.gnss_correction.preparation import Prepared, SignalStrengths, prepare
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.robust_bound import COMMON_M, COMMON_WITHOUT_IONOSPHERE_M
from services.gnss_correction.robust_filter import RobustFilter, RobustInput, seconds_of_week
from services.gnss_correction.settings import Config
from services.gnss_correction.solution import Solver
from services.gnss_correction.solver_arrays import RULES, Bools, Float64s, Records
from services.gnss_receiver.observations import Observations, satellite_code
from services.numerics.geodesy import ecef_from_geodetic

_NOT_WATCHED = frozenset({
    int(Rejection.NO_PSEUDORANGE),
    int(Rejection.ABSURD_PSEUDORANGE),
    int(Rejection.NO_SIGNAL),
    int(Rejection.EPOCH_REFUSED),
})  # fmt: skip
_USABLE, _MULTIPATH = int(Rejection.USABLE), int(Rejection.MULTIPATH)


def block_of(epoch: Epoch) -> Observations:
    """A message as a block of one epoch."""
    signals = tuple(dict.fromkeys(epoch.signals))
    number_of = {signal: number for number, signal in enumerate(signals)}
    return Observations(
        gps_week=np.array([epoch.gps_week], np.int64),
        tow_s=np.array([epoch.tow_s]),
        first_row=np.array([0, len(epoch.satellites)], np.int64),
        satellite=np.array([satellite_code(name) for name in epoch.satellites], np.uint16),
        signal=np.array([number_of[signal] for signal in epoch.signals], np.uint8),
        signals=signals,
        pseudorange_m=epoch.pseudorange_m,
        carrier_phase_cycles=epoch.carrier_phase_cycles,
        doppler_hz=epoch.doppler_hz,
        cn0_dbhz=epoch.cn0_dbhz,
        lock_lost=epoch.lock_lost,
    )


def silent_epoch() -> Epoch:
    """An epoch in which nothing was received: kernels compile on it before a real one waits for them."""
    nothing = np.empty(0)
    return Epoch(
        t_ns=0,
        gps_week=0,
        tow_s=0.0,
        satellites=(),
        signals=(),
        pseudorange_m=nothing,
        carrier_phase_cycles=nothing,
        doppler_hz=nothing,
        cn0_dbhz=nothing,
        lock_lost=np.empty(0, np.uint8),
    )


class Correction:
    """Corrects the epochs of one receiver, in the order in which they come."""

    def __init__(
        self,
        config: Config,
        methods: Sequence[Method] | None = None,
        thresholds: Thresholds | None = None,
        line: Line | None = None,
    ) -> None:
        """Solve by `methods`; by default the configured one and those to compare.

        `thresholds` of the receiver's own go before those of the settings. On a known `line` every fix
        has a chainage; without one the method `line` cannot be asked for (ValueError).
        """
        self.config = config
        self.methods: tuple[Method, ...] = tuple(dict.fromkeys(methods or (config.method, *config.compare)))
        self.order = EpochOrder()
        self.detector = MultipathDetector(config, thresholds)
        self._gatherer = EvidenceGatherer()
        self._store = EphemerisStore()
        self._solvers: dict[Method, Solver] = {method: Solver() for method in ("original", *self.methods)}
        self._smoothers = {m: CarrierSmoother(config.smooth_s) for m in self._solvers if config.smooth_s > 0.0}
        published = "robust" in self.methods or "line" in self.methods
        self._robust = RobustFilter(config.acceleration_mps2, config.bound_factor, watched=published)
        if line is None and "line" in self.methods:
            msg = "the method line needs a line"
            raise ValueError(msg)
        self._line = LineMethod(line) if line is not None and "line" in self.methods else None
        self._placings = {m: LinePlacing(line.geometry) for m in self._solvers} if line is not None else {}
        self._common_m = COMMON_WITHOUT_IONOSPHERE_M
        self._rules = np.zeros(1, RULES)
        self._rules["by_cn0"] = config.weights == "cn0"
        self._rules["elevation_mask_rad"] = np.radians(config.elevation_mask_deg)
        self._rules["cn0_mask_dbhz"] = config.cn0_mask_dbhz
        self._rules["most_pdop"] = config.most_pdop
        self._rules["longest_hold_s"] = config.longest_height_hold_s
        self._strengths = SignalStrengths(config.cn0_averaging_s)
        self._corrections = CorrectionTable(config.longest_correction_age_s, config.smooth_s)

    def add(self, broadcast: Ephemeris | Ionosphere) -> None:
        """Take in what a satellite broadcast. Without an ionosphere its night-time constant is used."""
        if isinstance(broadcast, Ephemeris):
            self._store.add(broadcast)
        else:
            self._rules["alpha"], self._rules["beta"] = broadcast.alpha, broadcast.beta
            self._common_m = COMMON_M

    def correct_by(self, corrections: Corrections) -> str:
        """Take in what a reference station corrects; gives why it is refused, empty when it is not."""
        return self._corrections.add(corrections)

    def epoch(self, epoch: Epoch) -> Corrected:
        """One epoch, solved and judged. An epoch whose time is no number is answered at `t_ns`."""
        return self.block(block_of(epoch), [epoch.t_ns])

    def block(self, observations: Observations, t_ns: Sequence[int] | None = None) -> Corrected:
        """Epochs, solved and judged one after the other; the result does not depend on the division into blocks."""
        weeks, tows_s = observations.gps_week.tolist(), observations.tow_s.tolist()
        refusals = [self.order.refusal(week, tow_s) for week, tow_s in zip(weeks, tows_s, strict=True)]
        table = self._store.table()
        refused = np.array([bool(one) for one in refusals], bool)
        prepared = prepare(observations, refused, table, self.config.systems, self._strengths)
        differential = self._corrections.apply(prepared, observations, table, self._rules[0])
        solutions: dict[Method, Solution] = {"original": self._solve("original", prepared, prepared.rows.copy())}
        judgements, flagged = self._judge(prepared, solutions["original"].rows)
        robust = self._filter(prepared, refused, table.gps_week, solutions["original"])
        for method in self.methods:
            if method == "robust":
                solutions[method] = robust
            elif method == "line":
                solutions[method] = self._follow(prepared, refused, table.gps_week, robust)
            elif method != "original":
                solutions[method] = self._solve(method, prepared, _altered(method, prepared.rows, judgements))
        self._place(solutions, prepared, table.gps_week)
        if t_ns is None:
            t_ns = [unix_ns_from_gps(week, tow_s) for week, tow_s in zip(weeks, tows_s, strict=True)]
        times = [
            (week, tow_s) if np.isfinite(tow_s) else gps_from_unix_ns(t)
            for t, week, tow_s in zip(t_ns, weeks, tows_s, strict=True)
        ]
        return Corrected(
            config=self.config,
            t_ns=t_ns,
            gps_week=[week for week, _ in times],
            tow_s=[tow_s for _, tow_s in times],
            refusals=refusals,
            table=table,
            prepared=prepared,
            judgements=judgements,
            flagged=flagged,
            evidence=self._gather(prepared, solutions["original"].rows, robust),
            solutions=solutions,
            differential=differential,
        )

    def _gather(self, prepared: Prepared, directed: Records, reference: Solution) -> Records:
        """Evidence of multipath in every row, against the place that the robust filter finds from all of them."""
        seen = directed.copy()
        seen["pseudorange_m"] = prepared.rows["pseudorange_m"]
        return self._gatherer.gather(
            prepared.first_row, prepared.gps_s, seen, reference.rows["residual_m"], reference.epochs
        )

    def _solve(self, method: Method, prepared: Prepared, rows: Records) -> Solution:
        if method in self._smoothers:
            self._smoothers[method].smooth(prepared.first_row, prepared.gps_s, rows)
        add_corrections(rows)
        epochs = self._solvers[method].solve(prepared.first_row, prepared.t_s, rows, self._rules[0])
        return Solution(epochs, rows)

    def _filter(self, prepared: Prepared, refused: Bools, gps_week: int, first: Solution) -> Solution:
        """Solutions of the robust filter, which starts from those of single epochs."""
        rows = prepared.rows.copy()
        if "robust" in self._smoothers:
            self._smoothers["robust"].smooth(prepared.first_row, prepared.gps_s, rows)
        add_corrections(rows)
        t_s, common_m = prepared.t_s + seconds_of_week(gps_week), self._common_of(prepared, first.epochs)
        given = RobustInput(prepared.first_row, t_s, refused, rows, first.epochs, common_m)
        return Solution(self._robust.solve(given, self._rules[0]), rows)

    def _common_of(self, prepared: Prepared, first: Records) -> Float64s:
        """What the satellites of each epoch share: less near a reference station that corrects them."""
        common_m = np.full(prepared.t_s.size, self._common_m)
        count = np.diff(prepared.first_row)
        epoch = np.repeat(np.arange(count.size), count)
        corrected = np.bincount(epoch, prepared.rows["correction_sigma_m"] > 0.0, count.size) > 0.0
        place_m = np.stack(ecef_from_geodetic(first["lat_rad"], first["lon_rad"], first["h_m"]), axis=-1)
        theirs_m = np.where(corrected, self._corrections.common_m(place_m), np.nan)
        return np.asarray(np.fmin(common_m, theirs_m))

    def _follow(self, prepared: Prepared, refused: Bools, gps_week: int, free: Solution) -> Solution:
        """Solutions along the line; it is held against those that know nothing of it."""
        if self._line is None:
            msg = "the method line needs a line"
            raise ValueError(msg)
        rows = prepared.rows.copy()
        add_corrections(rows)
        gps_s = prepared.t_s + gps_week * float(WEEK_S)
        given = LineInput(prepared.first_row, prepared.t_s, gps_s, refused, rows, free.epochs)
        epochs, reasons = self._line.solve(given, self._rules[0])
        return Solution(epochs, rows, reasons)

    def _place(self, solutions: dict[Method, Solution], prepared: Prepared, gps_week: int) -> None:
        """Give the fixes of the other methods their chainage."""
        gps_s = prepared.t_s + gps_week * float(WEEK_S)
        for method, placing in self._placings.items():
            if method in self.methods and method != "line":
                placed = placing.place(solutions[method].epochs, gps_s)
                solutions[method] = replace(solutions[method], epochs=placed)

    def _judge(self, prepared: Prepared, seen: Records) -> tuple[list[Judgement | None], list[int]]:
        """Judgement of every row, and the number of flagged satellites of each epoch."""
        judgements: list[Judgement | None] = [None] * len(seen)
        flagged = []
        first = prepared.first_row.tolist()
        columns = list(
            zip(
                prepared.rows["satellite"].tolist(),
                prepared.rows["signal"].tolist(),
                prepared.rows["pseudorange_m"].tolist(),
                prepared.rows["range_rate_mps"].tolist(),
                seen["elevation_rad"].tolist(),
                prepared.rows["carrier_m"].tolist(),
                strict=True,
            )
        )
        rejections = prepared.rows["rejection"].tolist()
        for epoch, t_s in enumerate(prepared.t_s.tolist()):
            watched = [i for i in range(first[epoch], first[epoch + 1]) if rejections[i] not in _NOT_WATCHED]
            count = 0
            for i, judgement in zip(
                watched, self.detector.judge(t_s, [Sight(*columns[i]) for i in watched]), strict=True
            ):
                judgements[i] = judgement
                count += judgement.flagged
            flagged.append(count)
        return judgements, flagged


def _altered(method: Method, rows: Records, judgements: Sequence[Judgement | None]) -> Records:
    """Rows as a method wants them: flagged ones rejected, or all their observables substituted."""
    altered = rows.copy()
    pseudorange_m, rejection = altered["pseudorange_m"], altered["rejection"]
    range_rate_mps, carrier_m = altered["range_rate_mps"], altered["carrier_m"]
    for i, judgement in enumerate(judgements):
        if judgement is None or not judgement.flagged or rejection[i] != _USABLE:
            continue
        if method == "adjust" and judgement.substitute is not None:
            pseudorange_m[i], range_rate_mps[i], carrier_m[i] = judgement.substitute
        else:
            rejection[i] = _MULTIPATH
    return altered
