"""`kirotei up`, `run`, `watch` and `config`: run services, look at them, check their settings."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

if TYPE_CHECKING:
    from services.runtime.config import Profile

ProfileFile = Annotated[
    Path | None, typer.Option("--profile", help="TOML profile of the host; the embedded demo when left out.")
]
ConfigFile = Annotated[
    Path | None, typer.Option("--config", help="TOML profile of the host; the embedded demo when left out.")
]
JsonFlag = Annotated[bool, typer.Option("--json", help="Print JSON.")]

config_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Check and explain settings.")


def _load(command: str, path: Path | None) -> Profile:
    """Profile, or an end with exit code 1 (2 when there is no such file) and one line per fault."""
    from services.runtime.config import ConfigError, load_host

    if path is not None and not path.is_file():
        typer.echo(f"kirotei {command}: {path}: no such file", err=True)
        raise typer.Exit(2)
    try:
        return load_host(path, os.environ)
    except ConfigError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from error


def up(profile: ProfileFile = None) -> None:
    """Run a host: the router and every service of its profile, restarted when they fail, until Ctrl-C.

    Example: kirotei up --profile deploy/profiles/onboard.toml
    """
    from services.runtime.supervisor import plans_of, run_supervisor

    host = _load("up", profile)
    run_supervisor(host, plans_of(host))


def run(
    service: Annotated[str, typer.Argument(help="Service, or instance such as 'gnss_receiver@rear'.")],
    config: ConfigFile = None,
) -> None:
    """Run one service until SIGTERM or Ctrl-C (what systemd starts).

    Example: kirotei run gnss_correction --config /etc/kirotei/host.toml
    """
    from services.runtime.catalogue import service_name, service_names, suggestion

    name = service_name(service)
    names = service_names()
    if name not in names:
        near = suggestion(name, names)
        typer.echo(f"kirotei run: no service {name!r}{near}; there are: {', '.join(names)}", err=True)
        raise typer.Exit(2)
    _run(name, service, _load("run", config))


def _run(name: str, instance: str, profile: Profile) -> NoReturn:
    from services.runtime.catalogue import load_service
    from services.runtime.main import run_service

    run_service(lambda: load_service(name), profile, instance)


def watch(
    *,
    once: Annotated[bool, typer.Option("--once", help="Print what is heard first, once, and end.")] = False,
    connect: Annotated[str | None, typer.Option(help="Router, 'tcp/127.0.0.1:7447'.")] = None,
    line: Annotated[str | None, typer.Option(help="Railway line to listen to.")] = None,
    config: ConfigFile = None,
    lang: Annotated[str, typer.Option(help="en or ja.")] = "en",
    as_json: Annotated[bool, typer.Option("--json", help="With --once: print JSON.")] = False,
) -> None:
    """Show trains and services live: fixes of every method, errors against truth, health.

    Example: kirotei watch --line demo
    """
    if lang not in ("en", "ja"):
        typer.echo(f"kirotei watch: --lang {lang}: there are en and ja", err=True)
        raise typer.Exit(2)
    if as_json and not once:
        typer.echo("kirotei watch: --json goes with --once", err=True)
        raise typer.Exit(2)
    import msgspec

    from services.runtime.host_config import BusConfig
    from services.runtime.watch import run_watch

    host = _load("watch", config).host
    bus = host.bus
    if connect is not None:
        try:
            bus = msgspec.convert(msgspec.structs.asdict(bus) | {"connect": [connect]}, BusConfig)
        except msgspec.ValidationError as error:
            typer.echo(f"kirotei watch: {connect!r} is no endpoint such as tcp/127.0.0.1:7447", err=True)
            raise typer.Exit(2) from error
    run_watch(bus, line or host.place.line, once=once, language="ja" if lang == "ja" else "en", as_json=as_json)


@config_app.command("check")
def check(
    file: Annotated[Path, typer.Argument(help="TOML profile of a host.")],
    *,
    as_json: JsonFlag = False,
) -> None:
    """Check a profile, its services' tables included, and list what is not at its default.

    Variables of the environment (KIROTEI__GNSS_CORRECTION__METHOD=remove) are taken in. Exit
    code 1 when anything is wrong. Example: kirotei config check deploy/profiles/demo.toml
    """
    from services.runtime.config_report import checked
    from services.runtime.state_dir import prepare, state_dir

    if not file.is_file():
        typer.echo(f"kirotei config check: {file}: no such file", err=True)
        raise typer.Exit(2)
    prepare(state_dir(os.environ), os.environ)
    report = checked(file, os.environ)
    if as_json:
        typer.echo(json.dumps(report.as_json(), indent=2, ensure_ascii=False))
    else:
        typer.echo(report.text(), err=bool(report.problems))
    raise typer.Exit(1 if report.problems else 0)


@config_app.command("show")
def show(
    service: Annotated[str, typer.Argument(help="A service; 'host' for the shared part.")],
    *,
    as_json: JsonFlag = False,
) -> None:
    """Explain every setting of a service: type, limits, default, meaning.

    Example: kirotei config show gnss_correction
    """
    from services.runtime.catalogue import UnknownServiceError
    from services.runtime.config_report import settings_of
    from services.runtime.config_words import config_table, field_rows
    from services.runtime.state_dir import prepare, state_dir

    prepare(state_dir(os.environ), os.environ)
    try:
        struct = settings_of(service)
    except UnknownServiceError as error:
        typer.echo(f"kirotei config show: {error}", err=True)
        raise typer.Exit(2) from error
    if as_json:
        import msgspec

        typer.echo(json.dumps(msgspec.to_builtins(field_rows(struct)), indent=2, ensure_ascii=False))
    else:
        typer.echo(config_table(struct))


app_commands = (up, run, watch)
"""Commands that stand on their own; `config_app` goes under `config`."""
