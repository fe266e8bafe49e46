"""Reasons and notes of the analysis in the report's language; the analysis itself speaks English.

Figures are taken over. What is not known here stays as it is: a foreign word says more than none.
"""

from __future__ import annotations

import re
from typing import Final

from services.run_history.report_words import Language

_N: Final = r"([\d.]+)"
_PHRASES: Final = (
    # Why a leg is left out, with its figures or, in sums, without.
    (rf"a gap of {_N} s", r"測位の欠測\1秒"),
    (r"a gap", "測位の欠測"),
    (rf"{_N} s without a credible speed", r"信頼できる速度が\1秒間なし"),
    (r"without a credible speed", "信頼できる速度のない時間が長い"),
    (rf"speeds and places disagree by {_N} m of way", r"速度と位置の走行距離が\1 m不一致"),
    (r"speeds and places disagree\s+(?:of )?way", "速度と位置の走行距離が不一致"),
    (rf"speeds and places disagree by {_N} m at the departure", r"発車時の速度と位置が\1 m不一致"),
    (r"speeds and places disagree\s+at the departure", "発車時の速度と位置が不一致"),
    (rf"{_N}% of its speeds contradict its places", r"速度の\1%が位置と矛盾"),
    (r"its speeds contradict its places", "速度と位置が矛盾"),
    (rf"{_N}% of its fixes off the track", r"測位の\1%が線路外"),
    (r"its fixes off the track", "測位が線路外"),
    (r"held between stations", "駅間で抑止"),
    (r"outside the hours", "対象時間帯外"),
    (r"there twice", "重複"),
    # What is said of a run.
    (rf"{_N} usable fixes: too few", r"有効な測位が\1点のみ"),
    (
        rf"{_N}% of its fixes lie near the line: the line of another railway\?",
        r"測位の\1%しか路線の近くにない:他路線の記録の可能性",
    ),
    (
        rf"its fixes jump to and fro by {_N} m: two devices under one run id, or a wild clock\?",
        r"測位が\1 m往復:1運行に2台の端末、または時計異常の可能性",
    ),
    (r"its speeds are km/h: divided by 3\.6", "速度がkm/hのため3.6で除算"),
    (
        rf"{_N} of {_N} rows left out: no place, no time, or a time that was there already",
        r"\2行中\1行を除外:位置・時刻なし、または時刻重複",
    ),
    (r"this file was left out: no track \(trk\) in this file", "このファイルは除外:トラック(trk)なし"),
    (r"this file was left out: no run in it", "このファイルは除外:運行なし"),
    (r"this file was left out: (.+)", r"このファイルは除外:\1"),
    (r"no speeds in the log: derived from places", "速度の記録なし:位置から算出"),
    (rf"its speeds come {_N} s after its places: brought together", r"速度が位置より\1秒遅れ:補正済み"),
    (rf"its speeds come {_N} s before its places: brought together", r"速度が位置より\1秒先行:補正済み"),
    (r"assumed, for no source is stated: (.+)", r"出典の記載がない仮定値:\1"),
    (
        r"no run counts: widen the hours \(--from-hour, --until-hour, --zone\)",
        "集計対象なし:時間帯を広げてください(--from-hour, --until-hour, --zone)",
    ),
    # Why there is no optimum.
    (r"the energy-saving run is itself the cheapest within its limits", "代表省エネパターンが制限内で最小"),
    (
        rf"no faster than {_N} s within limits, traction and brakes",
        r"制限速度・引張力・ブレーキの範囲では\1秒より短縮できない",
    ),
    (
        r"the train cannot get through: a gradient too steep for its traction, or a limit of zero",
        "走行不能:勾配に対して引張力が不足、または制限速度が0",
    ),
    (rf"{_N} m are too short for a profile", r"\1 mは走行曲線を求めるには短すぎる"),
)
_KNOWN: Final = tuple((re.compile(pattern), japanese) for pattern, japanese in _PHRASES)


def in_language(text: str, language: Language) -> str:
    """A reason or note; parts that are joined by semicolons each for itself, a run's name before a colon kept."""
    if language == "en":
        return text
    return ";".join(_part(part) for part in text.split("; "))


def _part(text: str) -> str:
    for pattern, japanese in _KNOWN:
        found = pattern.fullmatch(text)
        if found:
            return found.expand(japanese)
    name, colon, rest = text.partition(": ")
    return f"{name}:{_part(rest)}" if colon else text
