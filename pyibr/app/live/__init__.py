"""Live pages: a server that only this machine can open, and pictures that follow a page's camera."""
