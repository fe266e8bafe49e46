"""Live sources of bytes: serial lines and TCP connections, opened again when they fail, their rate watched."""
