"""The report's sections on GPUs: counted work with bounds for cards, and measurements on a real GPU."""

from __future__ import annotations

from pathlib import Path

from benchmarks.gpu.card import ALIKE, SAME
from benchmarks.gpu.gpu import CARDS
from benchmarks.results import Record, Result
from benchmarks.statistics import Quartiles
from benchmarks.tables import table, verdict

GPU = """## On GPUs, by counting

Each call draws a second frame from views that are kept on the device. Launches, waits, copies and work-items are
counted at the call's size. Oclgrind counts instructions and bytes at a smaller size, without a compiler's
optimizations; these counts are scaled by the number of pixels. Bytes are all that work-items request, as if there were
no cache. *Chain* is the number of instructions in the longest work-item of each launch, summed over launches. The
milliseconds are not measured. They are a bound, computed from these counts and the makers' published figures. A
kernel's bound is the longest of three times: for its bytes at the card's bandwidth, for its instructions at the card's
peak rate, and for its chain at four cycles per instruction. A call's bound is the sum over its kernels. It leaves out
savings by caches, and the costs of launches and of waiting for memory.{}
"""
BAR = ("four views", "NVIDIA A100 40 GB", 10.0)
"""A call, a card of 1.5 TB/s, and the largest accepted bound in milliseconds."""
PEER = """ For four views of 4096 x 2048, drawn at 2048 x 2048 on an RTX A4500, RVS-CUDA takes 130 ms according to its
program's notes, and less than 33 ms according to its paper."""
CARD = """## On a GPU
{}"""
EMPTY = """
No GPU has run these kernels yet. On a machine with a GPU, `make gpu` fills this section.
"""
MEASURED = """
The device is named below. Pictures are compared with a CPU's, value by value. At least {:.1%} of the values must be
alike: depths to a relative {:g}, colours to one step. Values differ at silhouettes, where rounding decides which
surface a pixel shows. Each time is for a second frame of kept views, including its copy to the host. Kernels' times
include the wait for each kernel. The driver reports private memory, for {:.0f} kernels; zeros are left out.
"""
_SHOWN = 0.01  # least fraction of a call's instructions for a kernel to be listed


def gpu_section(result: Result, _: Path) -> list[str]:
    """Tables of the calls with their bounds, and of each call's kernels."""
    calls = list(dict.fromkeys((r.parameters["call"], r.parameters["size"]) for r in result.records))
    rows: list[list[str]] = []
    kernels: list[list[str]] = []
    for call, size in calls:
        here = {(r.subject, r.quantity): r.values[0] for r in result.select(call=call, size=size)}
        names = list(dict.fromkeys(subject for subject, quantity in here if quantity == "instructions"))

        def total(quantity: str, here: dict[tuple[str, str], float] = here, names: list[str] = names) -> float:
            return sum(here[name, quantity] for name in names)

        told = [f"{here[str(call), what]:,.0f}" for what in ("launch", "wait", "upload", "download")]
        sums = [f"{total(what) / 1e6:,.1f}" for what in ("instructions", "read", "written")]
        of_cards = [f"{here[card, 'bound']:.2f}" for card in CARDS]
        rows.append([f"{call}, {size}", *told, *sums, f"{total('chain'):,.0f}", *of_cards])
        for name in names:
            if here[name, "instructions"] >= _SHOWN * total("instructions"):
                kernels.append([f"{call}, {size}", f"`{name}`", *_kernel(here, name)])
    heads = [
        "call",
        "launches",
        "waits",
        "bytes up",
        "bytes down",
        "10^6 instructions",
        "MB read",
        "MB written",
        "chain",
    ]
    of_kernels = ["call", "kernel", "work-items", "10^6 instructions", "MB read", "MB written", "chain"]
    compiled = ["sm_80: registers", "private bytes", "gfx90a: registers", "private bytes"]
    call, card, most = BAR
    bounds = [record.values[0] for record in result.select(subject=card, quantity="bound", call=call)]
    judged = [[call, card, f"{bound:.2f}", f"at most {most:g}", verdict(bound <= most)] for bound in bounds]
    return [
        GPU.format(PEER if bounds else ""),
        table([*heads, *(f"{name}: ms" for name in CARDS)], rows),
        table(["call", "card", "ms", "bar", ""], judged),
        table([*of_kernels, *compiled], kernels),
    ]


def card_section(result: Result, _: Path) -> list[str]:
    """Tables of tests, pictures and times on a GPU, or a note that there was none."""
    if not result.records:
        return [CARD.format(EMPTY)]
    tests = [[record.subject, f"{record.values[0]:.0f}"] for record in result.select(quantity="tests")]
    pictures = [
        [one.subject, f"{one.values[0]:.3%}", verdict(one.values[0] >= ALIKE), f"{same.values[0]:.3%}"]
        for one, same in zip(result.select(quantity="alike"), result.select(quantity="the same"), strict=True)
    ]
    times = [_timed(result, record) for record in result.select(quantity="end to end")]
    private = [
        [f"`{one.subject}`", f"{one.values[0]:.0f}"] for one in result.select(quantity="private") if one.values[0]
    ]
    kernels = next(result.select(subject="kernels", quantity="number")).values[0]
    return [
        CARD.format(MEASURED.format(ALIKE, SAME, kernels)),
        table(["tests", ""], tests),
        table(["picture", "alike", "", "the same"], pictures),
        table(["call", "ms", "in kernels", "slowest kernels, ms"], times),
        table(["kernel", "private bytes"], private),
    ]


def _timed(result: Result, whole: Record) -> list[str]:
    of_kernels = {one.subject: one.values[0] for one in result.select(quantity="kernel", **whole.parameters)}
    longest = sorted(of_kernels, key=of_kernels.__getitem__, reverse=True)[:4]
    told = ", ".join(f"`{name}` {of_kernels[name]:.2f}" for name in longest)
    in_kernels = f"{sum(of_kernels.values()):.2f}"
    return [f"{whole.subject}, {whole.parameters['size']}", str(Quartiles.of(whole.values)), in_kernels, told]


def _kernel(here: dict[tuple[str, str], float], name: str) -> list[str]:
    in_millions = [f"{here[name, what] / 1e6:,.1f}" for what in ("instructions", "read", "written")]
    counts = [f"{what}, {chip}" for chip in ("sm_80", "gfx90a") for what in ("registers", "private")]
    compiled = [f"{here[name, what]:.0f}" if (name, what) in here else "" for what in counts]
    return [f"{here[name, 'items']:,.0f}", *in_millions, f"{here[name, 'chain']:,.0f}", *compiled]
