"""A connection made secret by TLS, with errors that say what to do."""

from __future__ import annotations

import socket
import ssl

from services.byte_source.source import SourceError


def secured(plain: socket.socket, host: str, authority_file: str) -> socket.socket:
    """TLS over a connection to `host`, whose certificate must be signed by a known authority and name it.

    `authority_file` (PEM) holds the certificate of that authority; empty for those that the host system knows.
    Raises SourceError; the connection is closed then.
    """
    try:
        context = _context(authority_file)
    except SourceError:
        plain.close()
        raise
    try:
        return context.wrap_socket(plain, server_hostname=host)
    except ssl.SSLCertVerificationError as error:
        plain.close()
        msg = (
            f"the certificate of {host} is refused: {error.verify_message.rstrip('.')}; "
            "if its authority is your own, name it in authority_file"
        )
        raise SourceError(msg) from error
    except OSError as error:
        plain.close()
        msg = f"no TLS with {host}: {getattr(error, 'reason', None) or error}; check port and tls"
        raise SourceError(msg) from error


def _context(authority_file: str) -> ssl.SSLContext:
    """What is trusted. Raises SourceError where the file holds no certificate."""
    try:
        return ssl.create_default_context(cafile=authority_file or None)
    except ssl.SSLError as error:
        msg = f"authority_file {authority_file} holds no certificate (PEM)"
        raise SourceError(msg) from error
    except OSError as error:
        msg = f"authority_file {authority_file} cannot be read: {error.strerror}"
        raise SourceError(msg) from error
