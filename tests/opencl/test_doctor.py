"""The report on the devices of this machine, and kernels built in advance."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

import pyibr as ibr
from pyibr.app.cli import app
from pyibr.app.commands import doctor
from pyibr.opencl.device import current, devices
from pyibr.opencl.doctor import print_report, report
from tools.processes import run_python


def test_the_report_names_every_device_and_the_chosen_one(capsys: pytest.CaptureFixture[str], own_cache: Path):
    assert print_report() is True
    text = capsys.readouterr().out
    for device in devices():
        assert device.name in text
        assert (f"{device.index}  {device.platform}" in text) and device.version in text
        assert device.works or (device.reason in text and device.remedy in text)
    assert "Gflop/s" in text and str(own_cache) in text
    assert f"pyibr uses {current().device}" in text


def test_the_report_where_nothing_is_found(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PYIBR_DEVICE", "no such device")
    result = report()
    assert result.chosen is None and "$PYIBR_DEVICE" in result.why
    assert print_report() is False
    assert "no such device" in capsys.readouterr().out


@pytest.mark.parametrize(
    "encoding", ["ascii", *(pytest.param(e, marks=pytest.mark.thorough) for e in ("latin-1", "cp1252"))]
)
def test_the_report_may_go_where_not_all_characters_can(encoding: str):
    """Files on Windows and old terminals have such encodings."""
    code = "from pyibr.opencl.doctor import print_report; print_report()"
    done = run_python("-c", code, PYTHONIOENCODING=encoding)
    assert done.returncode == 0 and "pyibr uses" in done.stdout, done.stderr


BUILDS_NOTHING = """
import pyopencl as cl
make = cl.Program.__init__
def refuse(self, context, *rest):
    assert len(rest) == 2, 'built from source'
    make(self, context, *rest)
cl.Program.__init__ = refuse
from pyibr.app.commands import doctor
print(doctor.PICTURES[0]().valid.sum())
"""


def test_doctor_builds_beforehand(own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(doctor, "PICTURES", doctor.PICTURES[:1])
    monkeypatch.setattr(doctor, "print_report", lambda: True)
    current().kernels.clear()
    doctor._view.cache_clear()
    result = CliRunner().invoke(app, ["doctor", "--build"])
    assert result.exit_code == 0 and "kernels of 1 kinds of pictures are built" in result.output, result.output
    done = run_python("-c", BUILDS_NOTHING)
    assert done.returncode == 0 and int(done.stdout), done.stderr


@pytest.mark.parametrize("draw", doctor.PICTURES)
def test_what_doctor_draws_can_be_drawn(draw):
    assert isinstance(draw(), ibr.Frame | ibr.CleanedDepth)
