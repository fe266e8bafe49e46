"""What a report says, in English and Japanese."""

from __future__ import annotations

from typing import Final, Literal

Language = Literal["en", "ja"]

WORDS: Final[dict[str, tuple[str, str]]] = {
    "title": ("Run history and energy", "運転実績と力行電力量"),
    "estimate": (
        "Estimates from satellite positions, to support people: not certified, no driving order, no verdict on anyone.",
        "本書の値は測位記録からの推定値であり、認証された値でも運転指示でもなく、個人の評価の根拠とはなりません。",
    ),
    "upper_limit": (
        "The margin takes no account of signals and operation: it is an upper limit of what can be saved.",
        "省エネルギー化余地は信号や運行の都合を考慮しない上限であり、実際の効果はこれより小さくなります。",
    ),
    "summary": (
        "{runs} runs, {legs} legs, {counted} counted (departures from {from_h:g} to {until_h:g} h, {zone})",
        "{runs}運行、{legs}区間走行、うち集計対象{counted}({from_h:g}時〜{until_h:g}時発、{zone})",
    ),
    "pseudonyms": (
        "Runs are named by pseudonyms; dates are left out.",
        "運行名は仮名化し、日付は記載していません。",
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
    "hour": ("hour", "時台"),
    "departure": ("departure", "発車"),
    "energy_kwh": ("traction energy [kWh]", "力行電力量 [kWh]"),
    "energy_title": ("Energy by section, mean of the runs that count", "区間別電力量(集計対象の平均)"),
    "energy_told": (
        "The margin goes by traction alone. Regenerated energy and auxiliaries are estimates of their own beside it.",
        "余地は力行電力量のみで求め、回生・補機の電力量は別途の推定値です。",
    ),
    "legs_title": ("Runs of the section", "区間の各運行"),
    "run": ("run", "運行"),
    "traction_kwh": ("traction [kWh]", "力行 [kWh]"),
    "regenerated_kwh": ("regenerated [kWh]", "回生 [kWh]"),
    "auxiliaries_kwh": ("auxiliaries [kWh]", "補機 [kWh]"),
    "net_kwh": ("net [kWh]", "差引 [kWh]"),
    "quality": ("quality", "品質"),
    "sheet_facts": (
        "{hour} h · running time {time} s · traction {traction} kWh · energy over mean {share}",
        "{hour}時台 · 走行時分 {time}秒 · 力行 {traction} kWh · 正規化力行電力量 {share}",
    ),
    "sheet_apart": (
        "regenerated {regenerated} kWh · auxiliaries {auxiliaries} kWh",
        "回生 {regenerated} kWh · 補機 {auxiliaries} kWh",
    ),
    "notes": ("Notes", "注記"),
    "more": ("and {count} more", "ほか{count}件"),
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
        "{at:.2f} km付近で{from_kmh:.0f}→{low:.0f} km/hに減速後、{to:.0f} km/hへ再加速",
    ),
    "hill": (
        "From {a:.1f} to {b:.1f} km acceleration ends between {low:.0f} and {high:.0f} km/h (spread {spread:.0f} km/h)",
        "{a:.1f}〜{b:.1f} kmの加速終端速度は{low:.0f}〜{high:.0f} km/h(ばらつき{spread:.0f} km/h)",
    ),
    "leaves": (
        "From {a:.1f} to {b:.1f} km {runs} of {of} runs leave the reference by over 5 km/h (up to {most:.0f} km/h)",
        "{a:.1f}〜{b:.1f} kmで{of}本中{runs}本が基準記録から5 km/h超のずれ(最大{most:.0f} km/h)",
    ),
    "optimum_is": (
        "Optimum in the same {time:.0f} s: {kwh:.2f} kWh, {share:+.1f} % against the energy-saving run",
        "同一時分({time:.0f}秒)の最適走行:{kwh:.2f} kWh(代表省エネパターン比{share:+.1f}%)",
    ),
    "observed": (
        "On {share:.0f} % of the way no limit is known: there the optimum keeps to the speeds that runs had",
        "制限速度が不明の{share:.0f}%の区間では、最適走行は実績の速度を上限としています",
    ),
    "no_optimum": ("No optimum: {why}", "最適走行なし:{why}"),
    "top_lower": (
        "Accelerate {by:.0f} km/h less: the energy-saving run reached {best:.0f} km/h",
        "加速終端を{by:.0f} km/h下げる(代表省エネパターン {best:.0f} km/h)",
    ),
    "advice": ("How the optimum is driven", "最適走行の運転方法"),
    "advise_accelerate": (
        "{at:.2f} km: accelerate from {from_kmh:.0f} to {until_kmh:.0f} km/h ({length:.0f} m, {time:.0f} s)",
        "{at:.2f} km:{from_kmh:.0f}→{until_kmh:.0f} km/hへ加速({length:.0f} m,{time:.0f}秒)",
    ),
    "advise_hold": (
        "{at:.2f} km: hold {until_kmh:.0f} km/h for {length:.0f} m ({time:.0f} s)",
        "{at:.2f} km:{until_kmh:.0f} km/hで定速{length:.0f} m({time:.0f}秒)",
    ),
    "advise_coast": (
        "{at:.2f} km: coast from {from_kmh:.0f} to {until_kmh:.0f} km/h ({length:.0f} m, {time:.0f} s)",
        "{at:.2f} km:{from_kmh:.0f}→{until_kmh:.0f} km/hまで惰行({length:.0f} m,{time:.0f}秒)",
    ),
    "advise_brake": (
        "{at:.2f} km: brake from {from_kmh:.0f} to {until_kmh:.0f} km/h ({length:.0f} m, {time:.0f} s)",
        "{at:.2f} km:{from_kmh:.0f}→{until_kmh:.0f} km/hまで制動({length:.0f} m,{time:.0f}秒)",
    ),
    "over_limit": (
        "The energy-saving run exceeded a limit by {by:.0f} km/h; the optimum keeps it",
        "代表省エネパターンは制限速度を最大{by:.0f} km/h超過(最適走行は制限内)",
    ),
    "more_able": (
        "The optimum may do what the energy-saving run did beyond the vehicle file: {what}",
        "最適走行の性能は車両ファイルを超える実績値まで許容:{what}",
    ),
    "against": (
        "{time:+.0f} s and {energy:+.1f} % energy against the energy-saving run",
        "代表省エネパターンとの差:走行時分{time:+.0f}秒、力行電力量{energy:+.1f}%",
    ),
}


def said(key: str, language: Language, **figures: float | str) -> str:
    """A text in one language with its figures."""
    return WORDS[key][0 if language == "en" else 1].format(**figures)
