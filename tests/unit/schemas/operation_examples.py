"""One example of each of the messages of runs, bridges and services."""

from __future__ import annotations

from schemas.bridge import BridgeStatus, Document
from schemas.health import Health, InputHealth, ServiceEvent
from schemas.message import Message
from schemas.runs import RunRecord
from tests.unit.schemas.example_time import T_NS

EXAMPLES: dict[type[Message], Message] = {
    RunRecord: RunRecord(
        t_ns=T_NS,
        run_id="1774933200",
        from_station="juso",
        to_station="toyonaka",
        direction="up",
        departure_ns=T_NS - 421_500_000_000,
        arrival_ns=T_NS,
        running_time_s=421.5,
        energy_kwh=58.25,
        energy_sigma_kwh=2.5,
        quality=0.9,
        series="1000",
        vehicle="1000 series, 8 cars",
        line_version="2026-1",
    ),
    BridgeStatus: BridgeStatus(
        t_ns=T_NS,
        linked=True,
        backlog_records=12,
        backlog_bytes=4096,
        cap_bytes=2_000_000_000,
        oldest_ns=T_NS - 5,
        delay_events_s=0.2,
        delay_bulk_s=1.5,
        acknowledged=1000,
        dropped_bulk=0,
        dropped_events=0,
        quarantined=0,
    ),
    Document: Document(t_ns=T_NS, kind="line", name="demo", version="2026-1", content=b"{}", sha256="44" * 32),
    Health: Health(
        t_ns=T_NS,
        service="gnss_receiver@rear",
        boot_id="3f2a",
        level="degraded",
        reasons=("2 missing",),
        uptime_s=12.5,
        published=60,
        received=0,
        dropped=0,
        refused=1,
        counts={"epochs": 60},
        inputs=(
            InputHealth(key="k", source="s", received=3, missing=2, duplicated=0, restarts=0, age_s=0.1, delay_s=0.002),
        ),
    ),
    ServiceEvent: ServiceEvent(t_ns=T_NS, service="gnss_receiver", boot_id="3f2a", kind="started", text="ready"),
}
