"""Pictures: render targets, lights, and the drawing of things."""
