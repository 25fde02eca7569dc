"""What all of pyibr shares: cameras, their maps, errors, checks."""
