"""Commands and pages: the command line, and pages for looking around and for placing frusta."""
