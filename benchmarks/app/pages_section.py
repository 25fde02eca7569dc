"""The report's section on pages in the browser."""

from __future__ import annotations

from pathlib import Path

from benchmarks.app import pages
from benchmarks.results import Result
from benchmarks.statistics import Quartiles, number
from benchmarks.tables import only, table, verdict

PAGES = """## Pages in the browser

While the camera moves, `pyibr view` renders, encodes and sends pictures of up to {width} x {height}. One client is a
separate process, which sends sixty cameras a second and only receives pictures. The other is headless Chromium, which
draws the pictures on the same processor. *Width* is the pictures' width during the move, as a share of full width.
*Until full* is the time from the last camera to the lossless picture at full resolution; it includes a wait of 200 ms.
*Waits* is the largest number of requests that waited at one time. *Late* is the number of pictures that arrived after
the last camera, but before the lossless picture.
"""


def pages_section(result: Result, folder: Path) -> list[str]:
    """Rates and times until full resolution, with their limits."""
    rows: list[list[str]] = []
    found = {(record.subject, str(record.parameters["client"])) for record in result.records}
    order = [(name, client) for client in pages.RESTS for name in (*pages.RATES, pages.SLOW)]
    for name, client in (key for key in order if key in found):

        def values(quantity: str, name: str = name, client: str = client) -> list[float]:
            records = list(result.select(subject=name, client=client, quantity=quantity))
            return only(records) if records else []

        gaps, shares, rests = values("between pictures"), values("width"), values("until full")
        bar = (pages.DRAWN_RATE if client == pages.DRAWS else pages.RATES.get(name)) if name != pages.SLOW else None
        rate = 1e3 * len(gaps) / sum(gaps) if gaps else 0.0
        judged = [f"at least {bar:g}", verdict(rate >= bar)] if bar else ["", ""]
        rest = Quartiles.of(rests) if rests else None
        limit = pages.RESTS[client]
        rested = (
            [str(rest), f"at most {limit:g}", verdict(rest.median <= limit)]
            if rest and bar
            else [str(rest or ""), "", ""]
        )
        late = values("pictures after the last camera")
        rows.append(
            [
                name,
                client,
                number(rate),
                *judged,
                str(Quartiles.of(shares)) if shares else "",
                *rested,
                number(max(values("requests that wait"))),
                number(max(late)) if late else "",
            ]
        )
    if not rows:
        return []
    size = result.records[0].parameters
    heads = ["", "client", "pictures a second", "bar", "", "width", "until full (ms)", "bar", "", "waits", "late"]
    return [PAGES.format(width=size["width"], height=size["height"]), table(heads, rows)]
