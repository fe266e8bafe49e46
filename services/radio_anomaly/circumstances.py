"""What goes with a stretch on a pass: all that its cause is told from."""

from __future__ import annotations

from schemas.radio import Kind
from services.radio_anomaly.cause import Circumstances
from services.radio_anomaly.monitor import Judgement, Monitor, by_stream
from services.radio_anomaly.off_shares import OffShares
from services.radio_anomaly.passes import Journey, plain
from services.radio_anomaly.stream_state import POWERS, View, transmit_change
from services.radio_anomaly.stretch_figures import change_over
from services.radio_anomaly.weather_map import Sky


class Scene:
    """One pass with what was judged of it."""

    def __init__(self, monitor: Monitor, journey: Journey, judgement: Judgement, sky: Sky) -> None:
        """Compare every radio with its mean once, for all questions."""
        self._monitor, self._journey, self._judgement, self._sky = monitor, journey, judgement, sky
        self._shares = OffShares(judgement)
        self._ranges = monitor.presence.ranges(journey.direction)

    def at(self, kind: Kind, radio: str, channel: str, stretch: tuple[int, int]) -> Circumstances:
        """What goes with a stretch of a radio and channel; (0, 0) is the whole line."""
        monitor, journey, views = self._monitor, self._journey, self._judgement.views
        sign = 1.0 if kind == "above" else -1.0
        changes = {q: change_over(views.get((q, radio, channel)), stretch) for q in (*POWERS, "reception")}
        reception = views.get(("reception", radio, channel))
        ratio = normal = None
        if reception is not None and changes["reception"] is not None:
            ratio, normal = _received_and_normal(reception, stretch)
        share, sections = self._shares.of(radio, sign)
        other_share, other_radios = self._shares.others(radio, sign)
        learned = self._ranges.get(radio, set())
        whole = self._shares.range_of(radio, sign, stretch, learned, set(journey.passed))
        transmit = transmit_change(
            monitor.streams[(radio, channel)],
            by_stream(journey).get((radio, channel), []),
            monitor.settings,
            monitor.mask((radio, channel)),
            site=not journey.direction,
        )
        return Circumstances(
            kind=kind,
            length_m=stretch[1] * monitor.settings.section_m,
            at_site=not journey.direction,
            power_db=changes["power"],
            decoded_db=changes["decoded"],
            received_ratio=0.0 if ratio is None and kind == "missing" else ratio,
            normal_ratio=normal,
            strength_db=self._strength(views.get(("decoded", radio, channel)), reception, stretch),
            transmit_db=transmit,
            radio_share=share,
            radio_sections=sections,
            other_share=other_share,
            other_radios=other_radios,
            range_passed=whole.passed if journey.direction and whole.learned else None,
            range_learned=whole.learned,
            dead_share=whole.dead_share,
            louder_share=whole.louder_share,
            elsewhere_sections=whole.elsewhere,
            elsewhere_share=whole.elsewhere_share,
            weather=self._sky(self._middle_m(stretch)),
        )

    def _middle_m(self, stretch: tuple[int, int]) -> float | None:
        """Kilometrage of a stretch's middle; None at a site."""
        passed = self._journey.passed
        if not self._journey.direction:
            return None
        middle = stretch[0] + stretch[1] / 2.0 if stretch[1] else (passed[0] + passed[-1] + 1) / 2.0
        return middle * self._monitor.settings.section_m

    def _strength(self, view: View | None, reception: View | None, stretch: tuple[int, int]) -> float | None:
        """Decoded power above that at which reception fails, in the section of a stretch that lost most frames."""
        known = self._monitor.settings.loss_power_dbm
        if known is None:
            learned = self._monitor.curve.loss_power_dbm()
            known = learned[0] if learned is not None and learned[1] else None
        if view is None or known is None:
            return None
        rows = view.over(*stretch) if stretch[1] else slice(0, len(view.values))
        if rows.stop <= rows.start:
            return None
        if reception is None:
            return float(view.values[rows].mean()) - known
        lost = dict(zip(reception.residuals.sections.tolist(), reception.residuals.residual.tolist(), strict=True))
        heard = range(rows.start, rows.stop)
        worst = min(heard, key=lambda row: lost.get(int(view.residuals.sections[row]), 0.0))
        return float(view.values[worst]) - known


def _received_and_normal(reception: View, stretch: tuple[int, int]) -> tuple[float, float]:
    """Received ratio over a stretch now, and as it was learned."""
    rows = reception.over(*stretch) if stretch[1] else slice(0, len(reception.values))
    now = float(reception.values[rows].mean())
    return plain("reception", now), plain("reception", now - float(reception.residuals.residual[rows].mean()))
