"""What the commands do that read and write files."""
