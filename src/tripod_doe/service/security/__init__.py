"""Who may ask what, and what is delivered: sessions, keys to reports, limits of connections, files."""
