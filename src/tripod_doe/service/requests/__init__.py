"""Requests of clients: bodies and their forms, uploaded studies with their price, and studies to start from."""
