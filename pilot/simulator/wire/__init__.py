"""Being driven by a server, as the real simulator is."""
