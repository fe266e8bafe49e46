"""`kirotei topics`, `schema` and `decode`: what travels on the bus, for people and other languages."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

JsonFlag = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def topics(*, as_json: JsonFlag = False) -> None:
    """List every topic: key, message, delivery, nominal rate.

    Example: kirotei topics
    """
    from schemas import topics as table
    from schemas.topic import ROOT

    if as_json:
        rows = [
            {
                "name": topic.name,
                "key": f"{ROOT}/<line>/{topic.template}",
                "message": topic.schema_name,
                "delivery": topic.delivery.value,
                "rate_hz": topic.rate_hz,
                "about": topic.about,
            }
            for topic in table.ALL
        ]
        typer.echo(json.dumps(rows, indent=2, ensure_ascii=False))
        return
    typer.echo(f"Keys are {ROOT}/<line>/ and:\n")
    for topic in table.ALL:
        rate = "" if topic.rate_hz is None else f"{topic.rate_hz:g} Hz"
        typer.echo(
            f"{topic.template}\n    {topic.name:18}{topic.schema_name:22}{topic.delivery.value:8}{rate:6}{topic.about}"
        )


def schema(
    topic: Annotated[
        str, typer.Argument(help="Short name as `kirotei topics` shows it, 'gnss/fix', or a file: line, thresholds.")
    ],
) -> None:
    """Print the JSON schema of a topic's message or of a file.

    Example: kirotei schema gnss/fix
    """
    from schemas.codec import json_schema
    from schemas.files import file_schema
    from schemas.topic import TopicError
    from schemas.topics import topic_named

    of_file = file_schema(topic)
    if of_file is not None:
        typer.echo(json.dumps(of_file, indent=2, ensure_ascii=False))
        return
    try:
        found = topic_named(topic)
    except TopicError as error:
        typer.echo(f"kirotei schema: {error}", err=True)
        raise typer.Exit(2) from error
    typer.echo(json.dumps(json_schema(found.message), indent=2, ensure_ascii=False))


def decode(
    file: Annotated[Path | None, typer.Argument(help="Payload bytes; standard input when left out.")] = None,
    *,
    topic: Annotated[str | None, typer.Option(help="Topic's short name, 'gnss/fix'.")] = None,
    key: Annotated[str | None, typer.Option(help="Or the full key that the payload came on.")] = None,
    as_hex: Annotated[bool, typer.Option("--hex", help="The input is hexadecimal text.")] = False,
) -> None:
    """Turn one payload into JSON.

    Example: kirotei decode --topic gnss/fix fix.msgpack
    """
    from schemas import topics as table
    from schemas.codec import DecodeError, encode_json
    from schemas.codec import decode as decode_bytes
    from schemas.topic import TopicError

    if (topic is None) == (key is None):
        typer.echo("kirotei decode: give either --topic or --key", err=True)
        raise typer.Exit(2)
    try:
        if topic is not None:
            found = table.topic_named(topic)
        else:
            address = table.topic_of(key or "")
            if address is None:
                typer.echo(f"kirotei decode: no topic has the key {key}; see `kirotei topics`", err=True)
                raise typer.Exit(2)
            found = address.topic
    except TopicError as error:
        typer.echo(f"kirotei decode: {error}", err=True)
        raise typer.Exit(2) from error
    try:
        octets = sys.stdin.buffer.read() if file is None else file.read_bytes()
        payload = bytes.fromhex(octets.decode("ascii")) if as_hex else octets
        typer.echo(encode_json(decode_bytes(found.message, payload)).decode())
    except (DecodeError, OSError, ValueError) as error:
        typer.echo(f"kirotei decode: {file or 'standard input'}: {error}", err=True)
        raise typer.Exit(1) from error
