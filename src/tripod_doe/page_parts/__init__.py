"""Parts that all pages share: responses of a cube, tables, charts and templates. Whole pages are in `reports`."""
