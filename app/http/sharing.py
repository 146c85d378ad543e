"""Links through which others reach this server: its addresses, with a token per access kind."""

from __future__ import annotations

import io

from app.addresses import ONLY_HERE, ServerAddress, is_loopback, token_link
from app.contract.sharing import ShareLink, ShareLinks
from app.http.gate.access import Access
from app.http.gate.origins import parse_host
from app.http.gate.read_only_links import ReadOnlyLink
from app.settings import Settings


class Sharing:
    """The links of a server.

    Args:
        settings: where it listens; the port is given with each call, as the system may choose it.
        token: the operators'.
    """

    def __init__(self, settings: Settings, token: str) -> None:
        self._settings = settings
        self._token = token

    def links(
        self, read_only: ReadOnlyLink | None, port: int, asked_at: str | None = None
    ) -> ShareLinks:
        """Return the addresses of a read-only link, or those for operators.

        Args:
            read_only: None for operators.
            port: where the server listens.
            asked_at: the address that the requesting browser uses, as in ``http://lab.example``;
                it also works from outside a container.
        """
        settings = self._settings
        address = ServerAddress(settings.host, port, settings.tls, settings.allowed_hosts)
        others = list(address.elsewhere)
        if asked_at is not None:
            others = [asked_at, *(each for each in others if each != asked_at)]
        access = Access.OPERATOR if read_only is None else Access.READ_ONLY
        token = self._token if read_only is None else read_only.token
        links = [ShareLink(each, token_link(each, token), here=False) for each in others]
        note = None if links else ONLY_HERE.format(host=settings.host)
        here = ShareLink(address.here, token_link(address.here, token), here=True)
        return ShareLinks(access.value, [*links, here], note)


def qr_svg(text: str) -> bytes:
    """Draw a QR code as SVG, dark on white whatever is around it."""
    import segno

    file = io.BytesIO()
    code = segno.make(text, error="m", micro=False)
    code.save(
        file, kind="svg", xmldecl=False, omitsize=True, nl=False, dark="#000", light="#fff",
        svgclass=None, lineclass=None,
    )  # fmt: skip
    return file.getvalue()


def address_used(host: str, *, tls: bool) -> str | None:
    """Return the address that a browser used; None for the computer's own, such as localhost.

    Args:
        host: the ``Host`` that the gate accepted.
    """
    named = parse_host(host)
    if named is None or is_loopback(named.name):
        return None
    return f"{'https' if tls else 'http'}://{host}"
