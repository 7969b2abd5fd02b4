"""Keys to the pages of one run: a page in a sandbox sends no cookie, so its links contain a key."""

import hashlib
import hmac
import re

from tripod_doe.service.settings import Settings

_ADDRESS = re.compile(r"/api/v1/runs/([^/]+)/pages/([0-9a-f]{32})/.+")


def report_key(settings: Settings, run_id: str) -> str:
    """The key to the pages of one run, valid until the server ends."""
    return hmac.new(settings.token.encode(), f"{settings.key} {run_id}".encode(), hashlib.sha256).hexdigest()[:32]


def is_report_address(path: str, settings: Settings) -> bool:
    """Whether an address leads to a page with the right key."""
    match = _ADDRESS.fullmatch(path)
    return match is not None and hmac.compare_digest(match[2], report_key(settings, match[1]))
