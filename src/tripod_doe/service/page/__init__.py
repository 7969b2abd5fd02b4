"""The page of `tripod-doe serve`: HTML written by the server, with small scripts that keep it up to date.

What it shows comes through the same functions as the interface under ``/api/v1``; `docs/reference/service_page.md` says
why it is made this way.
"""
