"""Videos: what is written is read again, and what is none is told in silence."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.io import video
from pyibr.io.video import CODECS, Video, VideoWriter, check_video_output

FRAMES = [np.full((36, 62, 3), (200, 20 * number, 90), np.uint8) for number in range(7)]


def written(path: Path, frames: list[np.ndarray], fps: float = 12.5) -> Path:
    with VideoWriter(path, fps) as video:
        for frame in frames:
            video.add(frame)
    return path


@pytest.mark.parametrize("suffix", CODECS)
def test_frames_come_back(tmp_path: Path, suffix):
    video = Video(written(tmp_path / f"v{suffix}", FRAMES))
    assert len(video) == 7 and video.fps == pytest.approx(12.5)
    most = 0 if suffix == ".mkv" else 4  # levels that compression costs a single colour
    for numbers in (range(7), range(2, 7, 3), [6]):
        found = list(video.frames(numbers))
        assert len(found) == len(numbers)
        for number, frame in zip(numbers, found, strict=True):
            np.testing.assert_allclose(frame.astype(int), FRAMES[number], atol=most)


def test_floats_are_as_in_pictures(tmp_path: Path):
    path = written(tmp_path / "v.mkv", [frame.astype(np.float32) / 255 for frame in FRAMES])
    np.testing.assert_array_equal(list(Video(path).frames([3])), [FRAMES[3]])


def test_odd_sizes_lose_their_last_row_and_column(tmp_path: Path):
    (frame,) = Video(written(tmp_path / "v.mkv", [FRAMES[0][:35, :61]])).frames([0])
    assert frame.shape in ((35, 61, 3), (34, 60, 3))


def test_an_error_leaves_what_was_there(tmp_path: Path):
    path = tmp_path / "v.mp4"
    path.write_bytes(b"what was there")
    with pytest.raises(KeyError), VideoWriter(path, 30) as video:
        video.add(FRAMES[0])
        raise KeyError
    assert path.read_bytes() == b"what was there"
    assert [file.name for file in tmp_path.iterdir()] == ["v.mp4"]


@pytest.mark.parametrize("room", [0, video._ROOM])
@pytest.mark.parametrize("suffix", CODECS)
def test_frames_that_a_full_disk_swallows_are_missed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix, room):
    """OpenCV goes on as if nothing had happened."""
    noise = [np.random.default_rng(number).integers(0, 256, (36, 62, 3), dtype=np.uint8) for number in range(20)]
    path = written(tmp_path / f"v{suffix}", noise)
    size = path.stat().st_size
    path.write_bytes(b"what was there")
    monkeypatch.setattr(video, "_ROOM", room)
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)
    for share in (0.1, 0.5, 0.9, *([0.99] if room else [])):
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(share * size), unlimited[1]))
        try:
            with pytest.raises(ibr.FileFormatError, match=rf"v{suffix}: cannot be written: frames got lost in "):
                written(path, noise)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
        assert path.read_bytes() == b"what was there"
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_names_of_any_kind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    for name in ("10:30.mp4", "file:v.mp4", "a b%03d.mp4", "new\nline.mp4", "\N{SNOWMAN}.mp4", "-v.mp4"):
        assert len(Video(written(Path(name), FRAMES))) == len(FRAMES)
    name = written(tmp_path / "\udcff.mp4", FRAMES)
    code = "from pathlib import Path; from pyibr.io.video import Video; Video(Path('\\udcff.mp4'))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1 and "FileFormatError" in done.stderr.splitlines()[-1], done.stderr
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "\udcfe"))
    (tmp_path / "\udcfe").mkdir()
    with pytest.raises(ibr.FileFormatError, match="no text in UTF-8"):
        written(name, FRAMES)


def test_what_is_no_video_is_told_in_one_sentence_alone(tmp_path: Path):
    whole = written(tmp_path / "v.mp4", FRAMES).read_bytes()
    for data in (b"words " * 100, whole[:300], bytes(5000)):
        (tmp_path / "v.mp4").write_bytes(data)
        code = f"from pathlib import Path; from pyibr.io.video import Video; Video(Path({str(tmp_path / 'v.mp4')!r}))"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert done.stderr.count("\n") < 30 and "moov" not in done.stderr and "[ERROR" not in done.stderr
        assert done.stderr.strip().splitlines()[-1].endswith("v.mp4: not a readable video file, or truncated")
    with pytest.raises(ibr.FileFormatError, match="no such file"):
        Video(tmp_path / "none.mp4")


def test_what_cannot_be_written_is_told_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    check_video_output(tmp_path / "new.mp4")
    with pytest.raises(ibr.FileFormatError, match=r"no video format \.wmv"):
        check_video_output(tmp_path / "new.wmv")
    (tmp_path / "file").write_text("")
    with pytest.raises(ibr.FileFormatError, match="is not a folder"):
        check_video_output(tmp_path / "file/new.mp4")
    with pytest.raises(ibr.FileFormatError, match="cannot write a video of 1x1"):
        written(tmp_path / "v.mp4", [FRAMES[0][:1, :1]])
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ibr.MissingPackageError, match=r"pyibr-opencl\[opencv\]"):
        check_video_output(tmp_path / "new.mp4")
