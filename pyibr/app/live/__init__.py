"""Live pages: a server for this machine only, and pictures that follow a page's camera."""
