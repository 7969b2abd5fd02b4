"""A joint in motion: its poses over a revolution, a scale drawing, and a page that animates it in a browser."""
