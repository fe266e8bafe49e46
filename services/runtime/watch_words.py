"""Words of the terminal view, in English and Japanese. Pure."""

from __future__ import annotations

from typing import Literal

Language = Literal["en", "ja"]

WORDS: dict[str, dict[Language, str]] = {
    "method": {"en": "method", "ja": "方式"},
    "status": {"en": "status", "ja": "状態"},
    "age": {"en": "age", "ja": "経過"},
    "lat": {"en": "latitude", "ja": "緯度"},
    "lon": {"en": "longitude", "ja": "経度"},
    "used": {"en": "used", "ja": "使用"},
    "flagged": {"en": "flagged", "ja": "異常"},
    "error": {"en": "error", "ja": "誤差"},
    "mean": {"en": "mean", "ja": "平均"},
    "q95": {"en": "95 %", "ja": "95 %"},
    "minute": {"en": "last minute, 0-{top:.0f} m", "ja": "直近1分 0-{top:.0f} m"},
    "fix": {"en": "fix", "ja": "測位"},
    "predicted": {"en": "predicted", "ja": "予測"},
    "none": {"en": "none", "ja": "不能"},
    "stale": {"en": "stale", "ja": "途絶"},
    "train": {"en": "train {train}, receiver {device}", "ja": "列車 {train} 受信機 {device}"},
    "place_of": {"en": "train {train}", "ja": "列車 {train} の位置"},
    "valid": {"en": "valid", "ja": "有効"},
    "no_position": {"en": "lost", "ja": "位置不明"},
    "chainage": {"en": "chainage", "ja": "キロ程"},
    "speed": {"en": "speed", "ja": "速度"},
    "bounds": {"en": "front end within", "ja": "先頭の範囲"},
    "reference": {"en": "last reference", "ja": "最後の基準点"},
    "outside": {"en": "outside", "ja": "範囲外"},
    "services": {"en": "services", "ja": "サービス"},
    "service": {"en": "service", "ja": "サービス"},
    "level": {"en": "level", "ja": "健全度"},
    "rate": {"en": "msg/s", "ja": "件/秒"},
    "gaps": {"en": "missing", "ja": "欠落"},
    "dropped": {"en": "dropped", "ja": "破棄"},
    "restarts": {"en": "restarts", "ja": "再起動"},
    "reasons": {"en": "why", "ja": "理由"},
    "ok": {"en": "ok", "ja": "正常"},
    "degraded": {"en": "degraded", "ja": "低下"},
    "failed": {"en": "failed", "ja": "故障"},
    "lost": {"en": "lost", "ja": "消失"},
    "line": {"en": "line {line}", "ja": "路線 {line}"},
    "nothing": {"en": "nothing heard yet", "ja": "まだ何も受信していません"},
    "crowded": {"en": "more trains or services than can be shown", "ja": "表示しきれない列車・サービスがあります"},
    "primary": {"en": "main", "ja": "主"},
    "original": {"en": "original", "ja": "補正なし"},
    "remove": {"en": "remove", "ja": "除去"},
    "adjust": {"en": "adjust", "ja": "調整"},
    "robust": {"en": "robust", "ja": "頑健"},
}


def word(name: str, language: Language, **values: object) -> str:
    """Word in a language, its places filled; a name that is not listed stands for itself.

    >>> word("line", "ja", line="demo")
    '路線 demo'
    """
    entry = WORDS.get(name)
    return name if entry is None else entry[language].format(**values)
