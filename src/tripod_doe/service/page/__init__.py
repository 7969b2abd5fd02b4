"""The pages of `tripod-doe serve`: HTML from the server, with small scripts that keep it up to date.

Pages call the same functions as the interface under ``/api/v1``; `docs/reference/service_page.md` gives the reasons for
this design.
"""
