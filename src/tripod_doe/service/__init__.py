"""The service: studies submitted, watched, asked and compared over HTTP and from a browser.

It starts this project's own command line on result directories and reads what stands there; it has no second way to
run a study or to ask a cube. Importing this package imports no web code: `tripod_doe.service.server` does.
"""
