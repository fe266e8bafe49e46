"""What a report says, in English and Japanese."""

from __future__ import annotations

from typing import Final, Literal

from services.run_history.run_report import Driving, SectionReport, same_leg
from services.run_history.run_rows import RunRow
from services.run_history.speed_trace import KMH, SpeedTrace

Language = Literal["en", "ja"]

WORDS: Final[dict[str, tuple[str, str]]] = {
    "title": ("Run history and energy", "運転実績と力行電力量"),
    "estimate": (
        "Estimates from satellite positions, to support people: not certified, no driving order, no verdict on anyone.",
        "本書の値は測位記録からの推定値であり,認証された値でも運転指示でもなく,個人の評価の根拠とはなりません。",
    ),
    "upper_limit": (
        "The margin takes no account of signals and operation: it is an upper limit of what can be saved.",
        "省エネルギー化余地は信号や運行の都合を考慮しない上限であり,実際の効果はこれより小さくなります。",
    ),
    "summary": (
        "{runs} runs, {legs} legs, {counted} counted (departures from {from_h:g} to {until_h:g} h, {zone})",
        "{runs}運行,{legs}区間走行,うち集計対象{counted}({from_h:g}時~{until_h:g}時発,{zone})",
    ),
    "pseudonyms": (
        "Runs are named by pseudonyms; dates are left out.",
        "運行名は仮名化し,日付は記載していません。",
    ),
    "up": ("up", "起点から終点へ"),
    "down": ("down", "終点から起点へ"),
    "margin_title": ("Energy-saving margin", "省エネルギー化余地"),
    "section": ("section", "区間"),
    "direction": ("direction", "方向"),
    "series": ("series", "車系"),
    "runs": ("runs", "本数"),
    "within": ("within ±{s:g} s", "±{s:g}秒以内"),
    "reference": ("reference time", "基準時分"),
    "scheduled": ("scheduled", "査定"),
    "median": ("median", "中央値"),
    "mean": ("mean", "平均"),
    "minimum": ("minimum", "最小"),
    "margin": ("margin", "余地"),
    "interval": ("95 % interval", "95%区間"),
    "best": ("energy-saving run", "代表省エネパターン"),
    "remark": ("remark", "備考"),
    "small": ("small sample", "標本少数"),
    "none_counts": ("no run counts", "集計対象なし"),
    "no_schedule": ("no schedule known: median", "査定時分なし:中央値を使用"),
    "histogram": ("Running time", "走行時分の分布"),
    "scatter": ("Running time and traction energy", "走行時分と力行電力量"),
    "overlay": ("Speed over the way", "走行速度パターン"),
    "running_time": ("running time [s]", "走行時分 [s]"),
    "share": ("share of runs [%]", "割合 [%]"),
    "energy": ("traction energy / mean", "正規化力行電力量"),
    "speed": ("speed [km/h]", "速度 [km/h]"),
    "distance": ("from departure [km]", "発車駅からの距離 [km]"),
    "gradient": ("[‰]", "[‰]"),
    "population": ("all runs", "全運行"),
    "optimum": ("optimum, same time", "最適(同時分)"),
    "limit": ("limit", "制限速度"),
    "on_time_saving": ("on time, saving", "基準±1秒 省エネ"),
    "on_time_wasteful": ("on time, wasteful", "基準±1秒 非省エネ"),
    "slower_saving": ("about +10 s, saving", "基準+10秒近辺 省エネ"),
    "faster_saving": ("about −10 s, saving", "基準−10秒近辺 省エネ"),
    "fastest": ("fastest", "最速"),
    "margin_bars": ("Energy / mean of section and series", "正規化力行電力量"),
    "diagram": ("Time–distance diagram", "列車ダイヤ(スジ)"),
    "clock": ("time of day [h]", "時刻 [時]"),
    "place": ("place [km]", "位置 [km]"),
    "reception": ("Reception along the line", "受信状況"),
    "without_speed": ("fixes without speed [%]", "速度欠測 [%]"),
    "missing": ("missing time [s]", "欠測時間 [s]"),
    "longest": ("longest gap [s]", "最長欠測 [s]"),
    "stretch": ("stretch [km]", "区間 [km]"),
    "fixes": ("fixes", "測位数"),
    "left_out": ("Left out", "対象外"),
    "sheet": ("Crew sheet", "乗務員シート"),
    "this_run": ("this run", "この運行"),
    "hour": ("hour", "時間帯"),
    "departure": ("departure", "発車"),
    "energy_kwh": ("traction energy [kWh]", "力行電力量 [kWh]"),
    "notes": ("Notes", "注記"),
    "top": (
        "Top speed {best:.0f} km/h, the others {others:.0f} km/h",
        "最高速度 {best:.0f} km/h(他の運行 {others:.0f} km/h)",
    ),
    "limited": (
        "In sections of low limit {best:.0f} km/h on average, the others {others:.0f} km/h",
        "低い制限速度区間の平均 {best:.0f} km/h(他の運行 {others:.0f} km/h)",
    ),
    "approach": (
        "500 m before the stop {best:.0f} km/h, the others {others:.0f} km/h",
        "停車500 m手前 {best:.0f} km/h(他の運行 {others:.0f} km/h)",
    ),
    "again": (
        "Braked and accelerated again {best:.0f} times, the others {others:.1f} times",
        "減速再加速 {best:.0f}回(他の運行 平均{others:.1f}回)",
    ),
    "again_at": (
        "Braked at {at:.2f} km from {from_kmh:.0f} to {low:.0f} km/h and accelerated to {to:.0f} km/h again",
        "{at:.2f} km付近で{from_kmh:.0f}→{low:.0f} km/hに減速後,{to:.0f} km/hへ再加速",
    ),
    "hill": (
        "From {a:.1f} to {b:.1f} km acceleration ends between {low:.0f} and {high:.0f} km/h (spread {spread:.0f} km/h)",
        "{a:.1f}~{b:.1f} kmの加速終端速度は{low:.0f}~{high:.0f} km/h(ばらつき{spread:.0f} km/h)",
    ),
    "leaves": (
        "From {a:.1f} to {b:.1f} km {runs} of {of} runs leave the reference by over 5 km/h (up to {most:.0f} km/h)",
        "{a:.1f}~{b:.1f} kmで{of}本中{runs}本が基準記録から5 km/h超のずれ(最大{most:.0f} km/h)",
    ),
    "optimum_is": (
        "Optimum in the same {time:.0f} s: {kwh:.2f} kWh, {share:+.1f} % against the energy-saving run",
        "同一時分({time:.0f}秒)の最適走行:{kwh:.2f} kWh(代表省エネパターン比{share:+.1f}%)",
    ),
    "observed": (
        "No limits are known here: the optimum keeps to the highest observed speeds",
        "制限速度が不明のため,最適走行は実績の最高速度を上限としています",
    ),
    "no_optimum": ("No optimum: {why}", "最適走行なし:{why}"),
    "top_lower": (
        "Accelerate {by:.0f} km/h less: the energy-saving run reached {best:.0f} km/h",
        "加速終端を{by:.0f} km/h下げる(代表省エネパターン {best:.0f} km/h)",
    ),
    "against": (
        "{time:+.0f} s and {energy:+.1f} % energy against the energy-saving run",
        "代表省エネパターンとの差:走行時分{time:+.0f}秒,力行電力量{energy:+.1f}%",
    ),
}


def said(key: str, language: Language, **figures: float | str) -> str:
    """A text in one language with its figures."""
    return WORDS[key][0 if language == "en" else 1].format(**figures)


def difference_lines(section: SectionReport, language: Language) -> list[str]:
    """What the energy-saving run does differently, how hills spread, where the log leaves its reference."""
    driving = section.driving
    if driving is None:
        return []
    lines = []
    d = driving.difference
    if d is not None:
        lines.append(said("top", language, best=KMH * d.top_mps, others=KMH * d.top_others_mps))
        if d.limited_mps is not None and d.limited_others_mps is not None:
            lines.append(
                said("limited", language, best=KMH * d.limited_mps, others=KMH * d.limited_others_mps),
            )
        lines.append(said("approach", language, best=KMH * d.approach_mps, others=KMH * d.approach_others_mps))
        lines.append(said("again", language, best=d.reaccelerations, others=d.reaccelerations_others))
    return [*lines, *_optimum_lines(section, driving, language), *_place_lines(driving, language)]


def _optimum_lines(section: SectionReport, driving: Driving, language: Language) -> list[str]:
    if driving.no_optimum:
        return [said("no_optimum", language, why=driving.no_optimum)]
    if driving.optimum is None or section.margin is None:
        return []
    best_kwh = section.margin.best.energy_kwh
    kwh = driving.optimum.traction_kwh
    share = 100.0 * (kwh / best_kwh - 1.0)
    told = said("optimum_is", language, time=driving.optimum.running_time_s, kwh=kwh, share=share)
    return [told, said("observed", language)] if driving.limits_observed else [told]


def _place_lines(driving: Driving, language: Language) -> list[str]:
    hills = [
        said(
            "hill",
            language,
            a=hill.start_m / 1000.0,
            b=hill.end_m / 1000.0,
            low=KMH * float(hill.peaks_mps.min()),
            high=KMH * float(hill.peaks_mps.max()),
            spread=KMH * hill.spread_mps,
        )
        for hill in driving.hills
    ]
    leaves = [
        said(
            "leaves",
            language,
            a=one.start_m / 1000.0,
            b=one.end_m / 1000.0,
            runs=one.runs,
            of=one.of_runs,
            most=KMH * one.largest_mps,
        )
        for one in driving.departures
    ]
    return [*hills, *leaves]


def row_of_trace(section: SectionReport, trace: SpeedTrace) -> RunRow:
    """Row of a trace of the same section."""
    return next(row for row in section.group.rows if same_leg(trace, row))


def sheet_lines(section: SectionReport, run: int, language: Language) -> list[str]:
    """What one driver may take from one run (a number of `driving.traces`), against the energy-saving run."""
    driving, margin = section.driving, section.margin
    if driving is None:
        return []
    lines = []
    trace = driving.traces[run]
    if margin is not None and driving.best is not None and run != driving.best:
        row = row_of_trace(section, trace)
        share = 100.0 * (row.energy_kwh / margin.best.energy_kwh - 1.0)
        lines.append(
            said("against", language, time=row.running_time_s - margin.best.running_time_s, energy=share),
        )
        top = KMH * float(driving.speeds_mps[run].max())
        best = KMH * float(driving.speeds_mps[driving.best].max())
        if top > best + 1.0:
            lines.append(said("top_lower", language, by=top - best, best=best))
    lines += [
        said(
            "again_at",
            language,
            at=dip.at_m / 1000.0,
            from_kmh=KMH * dip.from_mps,
            low=KMH * dip.low_mps,
            to=KMH * dip.to_mps,
        )
        for dip in driving.again[run]
    ]
    return lines
