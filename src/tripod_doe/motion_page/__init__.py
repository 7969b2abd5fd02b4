"""A joint in motion: its poses over a revolution, a drawing to scale, and a page that moves it in a browser."""
