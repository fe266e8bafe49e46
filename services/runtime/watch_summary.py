"""What `kirotei watch --once --json` prints of the trains and services of a line."""

from __future__ import annotations

from services.runtime.watch_state import WatchState
from services.runtime.watch_trains_view import status_of
from services.runtime.watch_view import fix_status, service_level

Row = dict[str, object]


def summary(state: WatchState, now_s: float) -> Row:
    """Positions, fixes and services, as of now."""
    return {
        "line": state.line,
        "positions": _positions(state, now_s),
        "fixes": _fixes(state, now_s),
        "services": _services(state, now_s),
    }


def _positions(state: WatchState, now_s: float) -> list[Row]:
    return [
        {
            "train": view.train,
            "status": status_of(view, now_s),
            "age_s": view.age_s(now_s),
            "chainage_m": view.position.chainage_m,
            "axis_m": view.position.axis_m,
            "branch": view.position.branch,
            "direction": view.position.direction,
            "speed_mps": view.position.speed_mps,
            "bound_ahead_m": view.position.bound_ahead_m,
            "bound_behind_m": view.position.bound_behind_m,
            "error_m": view.error_m,
            "outside_bounds": view.outside,
        }
        for view in state.trains.values()
        if view.position is not None
    ]


def _fixes(state: WatchState, now_s: float) -> list[Row]:
    return [
        {
            "train": device.train,
            "device": device.device,
            "method": row.method,
            "primary": row.primary,
            "status": fix_status(row, now_s),
            "age_s": row.age_s(now_s),
            "lat_deg": row.fix.lat_deg if row.fix else None,
            "lon_deg": row.fix.lon_deg if row.fix else None,
            "error_m": row.error_m,
            "mean_error_m": row.mean_m(),
            "error_95_m": row.quantile_m(0.95),
        }
        for device in state.devices.values()
        for row in device.ordered()
    ]


def _services(state: WatchState, now_s: float) -> list[Row]:
    return [
        {
            "source": view.source,
            "level": service_level(view, now_s),
            "boot_id": view.health.boot_id,
            "age_s": view.age_s(now_s),
            "rate_hz": view.rate_hz,
            "missing": view.missing(),
            "restarts": view.restarts,
            "reasons": list(view.health.reasons),
        }
        for view in state.services.values()
    ]
