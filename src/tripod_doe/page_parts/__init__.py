"""Parts that all pages share: responses of a cube, tables, charts and templates. Pages themselves are in `pages`."""
