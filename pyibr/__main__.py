"""`python -m pyibr`: the command line."""

from pyibr.app.cli import app

if __name__ == "__main__":
    app(prog_name="pyibr")
