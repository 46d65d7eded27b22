"""Where the web server listens."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import urlsplit

FORMS = "allowed: HOST:PORT such as 127.0.0.1:8080 or [::1]:8080, or off"
OFF = ("off", "none")


@dataclass(frozen=True, slots=True)
class Address:
    """A host and a port, 0 for any that is free.

    `required` says that somebody asked for it: then a manager that cannot have it does not start.
    """

    host: str
    port: int
    required: bool = True

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


DEFAULT = Address("127.0.0.1", 8080, required=False)
"""This machine only, and where another program has the port, nowhere."""


def parse(text: str | None) -> Address | None:
    """The address that was asked for, the default one for None, none for `off`. Raises ValueError."""
    if text is None:
        return DEFAULT
    if text in OFF:
        return None
    try:
        parts = urlsplit(f"//{text}")
        host, port = parts.hostname, parts.port
    except ValueError:
        raise ValueError(f"{text!r}; {FORMS}") from None
    if not host or port is None or parts.netloc != text or "@" in text:
        raise ValueError(f"{text!r}; {FORMS}")
    return Address(host, port)
