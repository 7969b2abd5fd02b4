"""The service: submit, watch, query and compare studies over HTTP or in a browser.

It starts this project's own command line on result directories and reads their files; it has no second way to run a
study or to query a cube. Importing this package imports no web code: `tripod_doe.service.server` does.
"""
