"""What people start: the command line, and the pages for looking around and for placing frusta."""
