"""Content security policies: what a browser may load and run in each kind of page."""

_EMPTY_STYLE = "'sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU='"
PAGES = (
    "default-src 'none'; script-src 'self'; connect-src 'self'; img-src 'self' data: blob:; "
    f"style-src 'self' {_EMPTY_STYLE}; frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
"""No inline script, no inline style, nothing from other servers.

Two exceptions: the hash of an empty style element, which Plotly creates and fills with rules, not with text; and
pictures from data: and blob: addresses, with which Plotly draws heat maps and saves figures.
"""

DOCUMENTATION = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
"""No inline code, nothing from other servers; the search of the site may read its pages."""

SANDBOX = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'"
)
"""For pages with inline styles and scripts: the sandbox keeps them from the cookie and the interface."""

OTHERS = "default-src 'none'; frame-ancestors 'none'"
"""Of every answer that does not set its own."""
