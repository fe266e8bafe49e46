"""The reference station that the wayside profile holds in comments starts as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

from services.runtime.config_report import checked

PROFILE = Path(__file__).parents[3] / "deploy" / "profiles" / "wayside.toml"


def test_the_commented_station_is_valid_once_it_is_taken_in(tmp_path: Path) -> None:
    text = PROFILE.read_text("utf-8")
    block = text[text.index("# [gnss_reference]") :]
    uncommented = re.sub(r"^# ?", "", block, flags=re.MULTILINE)
    taken_in = text.replace(block, uncommented).replace('services = ["recorder"]', 'services = ["gnss_reference"]')
    site = tmp_path / "site.toml"
    site.write_text(re.sub(r"\[recorder\]\nkeep_gb.*\n", "", taken_in), "utf-8")
    report = checked(site, {})
    assert report.problems == []
    assert report.notes == []
