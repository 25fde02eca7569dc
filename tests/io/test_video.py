"""Videos read back with their times and sound; invalid files give one error, and libraries print nothing."""

from __future__ import annotations

import base64
import ctypes
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from pyibr.io.video import Video
from pyibr.io.video_writing import CODECS, VideoWriter, check_video_output
from tests.app.browser import chromium
from tools.processes import run_python

av = pytest.importorskip("av", reason="needs PyAV, of the extra video")

FRAMES = [np.full((36, 62, 3), (200, 20 * number, 90), np.uint8) for number in range(7)]
FILMS = [(suffix, codec) for suffix, codecs in CODECS.items() for codec in codecs if suffix not in (".gif", ".webp")]


def written(path: Path, frames: list[np.ndarray], fps: float = 12.5, **options: Any) -> Path:
    ibr.write_video(path, frames, fps, **options)
    return path


def with_sound(path: Path, seconds: float = 2.0, turned: int = 0) -> Path:
    """Write a film with a tone, at 25 frames per second, but irregular times."""
    with av.open(str(path), "w") as container:
        video, audio = container.add_stream("libx264", rate=25), container.add_stream("aac", rate=44100)
        video.width, video.height, video.pix_fmt = 62, 36, "yuv420p"
        video.codec_context.time_base = Fraction(1, 1000)
        for number in range(round(25 * seconds)):
            frame = av.VideoFrame.from_ndarray(np.full((36, 62, 3), 4 * number, np.uint8), format="rgb24")
            frame.pts, frame.time_base = 40 * number + number % 3, Fraction(1, 1000)
            container.mux(video.encode(frame))
        container.mux(video.encode())
        times = np.arange(round(44100 * seconds)) / 44100
        wave = (0.3 * np.sin(2764 * times)).astype(np.float32)[None]
        tone = av.AudioFrame.from_ndarray(wave, format="fltp", layout="mono")
        tone.sample_rate, tone.pts = 44100, 0
        container.mux(audio.encode(tone))
        container.mux(audio.encode())
    return path


@pytest.mark.parametrize(("suffix", "codec"), FILMS)
def test_frames_come_back(tmp_path: Path, suffix: str, codec: Any):
    codec = None if codec == "mjpeg" else codec
    video = Video(written(tmp_path / f"v{suffix}", FRAMES, codec=codec))
    assert len(video) == 7 and video.fps == pytest.approx(12.5)
    np.testing.assert_allclose(video.times, np.arange(7) / 12.5, atol=2e-3)  # Matroska stores milliseconds
    most = 0 if codec == "ffv1" else 5  # error of compression for a uniform colour, in levels of 255
    for numbers in (range(7), range(2, 7, 3), [6]):
        found = list(video.frames(numbers))
        assert len(found) == len(numbers)
        for number, frame in zip(numbers, found, strict=True):
            np.testing.assert_allclose(frame.astype(int), FRAMES[number], atol=most)


def test_colours_are_as_told_in_large_videos(tmp_path: Path):
    """Large videos use HDTV's colour standard, which differs from the older one by 8 levels of green here."""
    frame = np.full((720, 64, 3), (40, 200, 90), np.uint8)
    (read,) = Video(written(tmp_path / "v.mp4", [frame]))
    np.testing.assert_allclose(read.astype(int), frame, atol=3)


@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_moving_pictures(tmp_path: Path, suffix: str):
    written(tmp_path / f"v{suffix}", FRAMES, 30)
    with Image.open(tmp_path / f"v{suffix}") as image:
        shown: list[Any] = []
        for number in range(image.n_frames):  # pyright: ignore[reportAttributeAccessIssue]
            image.seek(number)
            shown.append((np.asarray(image.convert("RGB"))[5, 5].astype(int), image.info["duration"]))
    np.testing.assert_allclose([color for color, _ in shown], [frame[5, 5] for frame in FRAMES], atol=12)
    assert sum(duration for _, duration in shown) == pytest.approx(7000 / 30, abs=10)


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's mallopt")
@pytest.mark.parametrize("count", [1, 2, 3])
def test_short_films_whatever_memory_holds(tmp_path: Path, count: int):
    mallopt, perturb = ctypes.CDLL(None).mallopt, -6
    mallopt(perturb, 90)  # from now on, glibc fills new memory with this byte's complement
    try:
        frames = [np.full((36, 64, 3), 40 * number, np.uint8) for number in range(count)]
        video = Video(written(tmp_path / "v.mkv", frames, codec="h265"))
    finally:
        mallopt(perturb, 0)
    assert len(video) == count


@pytest.mark.parametrize(("codec", "bits"), [("h264", 10), ("h265", 12), ("ffv1", 16)])
def test_more_bits(tmp_path: Path, codec: Any, bits: int):
    ramp = np.repeat(np.linspace(0, 1, 64, dtype=np.float32)[None, :, None], 36, 0).repeat(3, -1)
    video = Video(written(tmp_path / "v.mkv", [ramp], codec=codec, bits=bits))
    (numbers,) = video.gray([0])
    assert numbers.dtype == np.uint16
    exact = {10: 4 * 4, 12: 2 * 16, 16: 1}[bits]  # error of compression for an 8-bit ramp, in levels of `bits` bits
    np.testing.assert_allclose(numbers.astype(int), ramp[..., 0] * ((1 << bits) - 1), atol=exact)


def test_floats_and_words_are_as_in_pictures(tmp_path: Path):
    for frames in ([f.astype(np.float32) / 255 for f in FRAMES], [f.astype(np.uint16) * 257 for f in FRAMES]):
        path = written(tmp_path / "v.mkv", frames)
        np.testing.assert_array_equal(list(Video(path).frames([3])), [FRAMES[3]])


def test_odd_sizes_lose_their_last_row_and_column(tmp_path: Path):
    for suffix, shape in ((".mkv", (35, 61, 3)), (".mp4", (34, 60, 3))):
        (frame,) = Video(written(tmp_path / f"v{suffix}", [FRAMES[0][:35, :61]])).frames([0])
        assert frame.shape == shape


def heard(path: Path) -> Any:
    with av.open(str(path)) as container:
        return np.concatenate([frame.to_ndarray()[0] for frame in container.decode(audio=0)])


def test_sound_and_times_are_carried_over(tmp_path: Path):
    source = Video(with_sound(tmp_path / "s.mp4"))
    assert source.has_sound and len(source) == 50
    with VideoWriter(tmp_path / "v.mp4", 25, sound=source.path, start=source.times[10]) as video:
        for number, frame in zip(range(10, 40), source.frames(range(10, 40)), strict=True):
            video.add(frame, source.times[number] - source.times[10])
    made = Video(tmp_path / "v.mp4")
    np.testing.assert_allclose(made.times, np.array(source.times[10:40]) - source.times[10], atol=1e-4)
    whole, part = heard(source.path), heard(made.path)
    assert len(part) / 44100 == pytest.approx(30 / 25, abs=0.05)  # AAC codes blocks of 23 ms
    assert np.sqrt(np.mean(part[4410:-4410] ** 2)) == pytest.approx(np.sqrt(np.mean(whole[4410:-4410] ** 2)), rel=0.01)


def test_sound_that_does_not_fit_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    written(tmp_path / "v.webm", FRAMES, sound=with_sound(tmp_path / "s.mp4"))
    assert "sound of" in caplog.text and not Video(tmp_path / "v.webm").has_sound


def test_frames_are_turned_as_players_turn_them(tmp_path: Path):
    frame = np.zeros((36, 62, 3), np.uint8)
    frame[:18, :31] = 255  # the upper left quarter
    path = written(tmp_path / "v.mp4", [frame])
    data = path.read_bytes()
    matrix = data.index(b"tkhd") + 4 + 40
    assert data[matrix : matrix + 36] == turned(1, 0, 0, 1)
    path.write_bytes(data[:matrix] + turned(0, 1, -1, 0) + data[matrix + 36 :])  # a quarter turn clockwise
    (shown,) = Video(path)
    assert shown.shape == (62, 36, 3)
    np.testing.assert_allclose(shown.astype(int), np.rot90(frame, -1), atol=40)  # compression blurs edges


def turned(a: int, b: int, c: int, d: int) -> bytes:
    """Bytes of an MP4 track's matrix: fixed-point numbers of 16.16 bits, of 2.30 bits in the last column."""
    words = (a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30)
    return b"".join(word.to_bytes(4, "big", signed=True) for word in words)


def test_an_error_leaves_what_was_there(tmp_path: Path):
    path = tmp_path / "v.mp4"
    path.write_bytes(b"what was there")
    with pytest.raises(KeyError), VideoWriter(path, 30) as video:
        video.add(FRAMES[0])
        raise KeyError
    assert path.read_bytes() == b"what was there"
    assert [file.name for file in tmp_path.iterdir()] == ["v.mp4"]


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_film_that_is_interrupted_keeps_its_frames(tmp_path: Path, suffix: str):
    path = tmp_path / f"v{suffix}"
    with pytest.raises(KeyboardInterrupt), VideoWriter(path, 25) as video:
        for frame in FRAMES[:4]:
            video.add(frame)
        raise KeyboardInterrupt
    with av.open(str(path)) as container:
        assert sum(1 for _ in container.decode(video=0)) == 4
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".gif"])
def test_a_full_disk_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str):
    noise = [np.random.default_rng(number).integers(0, 256, (36, 62, 3), dtype=np.uint8) for number in range(20)]
    resource = pytest.importorskip("resource")
    path = written(tmp_path / f"v{suffix}", noise)
    size = path.stat().st_size
    path.write_bytes(b"what was there")
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)
    for share in (0.1, 0.9):
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(share * size), unlimited[1]))
        try:
            with pytest.raises(ibr.FileFormatError, match=rf"v{suffix}: cannot be written"):
                written(path, noise)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
        assert path.read_bytes() == b"what was there"
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_names_of_any_kind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    for name in ("10:30.mp4", "file:v.mp4", "a b%03d.mp4", "new\nline.mp4", "\N{SNOWMAN}.mp4", "-v.mp4", "\udcff.mp4"):
        assert len(Video(written(Path(name), FRAMES))) == len(FRAMES)


def test_what_is_no_video_is_told_in_one_sentence_alone(tmp_path: Path):
    whole = written(tmp_path / "v.mp4", FRAMES).read_bytes()
    for data in (b"words " * 100, whole[:300], bytes(5000)):
        (tmp_path / "v.mp4").write_bytes(data)
        code = f"from pathlib import Path; from pyibr.io.video import Video; Video(Path({str(tmp_path / 'v.mp4')!r}))"
        done = run_python("-c", code)
        assert done.stderr.count("\n") < 30 and "moov" not in done.stderr and "[ERROR" not in done.stderr
        assert done.stderr.strip().splitlines()[-1].endswith("v.mp4: not a readable video file, or truncated")
    with pytest.raises(ibr.FileFormatError, match="no such file"):
        Video(tmp_path / "none.mp4")


def test_what_cannot_be_written_is_told_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    check_video_output(tmp_path / "new.mp4")
    (tmp_path / "file").write_text("")
    for name, said in (("new.wmv", r"no video format \.wmv"), ("file/new.mp4", "is not a folder")):
        with pytest.raises(ibr.FileFormatError, match=said):
            check_video_output(tmp_path / name)
    several = [FRAMES[0], FRAMES[1][:, :60]]
    for error, said, name, frames, fps, options in (
        (ibr.ArgumentError, "codec: expected vp9 or av1 for .*, got ", "new.webm", FRAMES, 25, {"codec": "h264"}),
        (ibr.ArgumentError, "bits: expected 8 or 10 for h264, got 12", "new.mp4", FRAMES, 25, {"bits": 12}),
        (ibr.ArgumentError, "fps: expected frames a second > 0, got int 0", "new.mp4", FRAMES, 0, {}),
        (ibr.ArgumentError, "frames: expected all of one size, 62x36, got 60x36", "new.mp4", several, 25, {}),
        (ibr.FileFormatError, "a video without a frame", "new.mp4", [], 25, {}),
        (ibr.FileFormatError, "cannot write a video of 1x1", "v.mp4", [FRAMES[0][:1, :1]], 25, {}),
    ):
        with pytest.raises(error, match=said):
            ibr.write_video(tmp_path / name, frames, fps, **options)
    assert [file.name for file in tmp_path.iterdir()] == ["file"]
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ibr.MissingPackageError, match=r"pyibr-opencl\[video\]"):
        check_video_output(tmp_path / "new.mp4")


PLAY = """
async () => {
    const film = document.querySelector('video');
    const ended = new Promise((done, fail) => { film.onended = done; film.onerror = () => fail(film.error.message); });
    await film.play();
    await ended;
    const drawn = document.createElement('canvas').getContext('2d');
    drawn.drawImage(film, 0, 0);
    return [film.videoWidth, film.videoHeight, film.duration, ...drawn.getImageData(40, 20, 1, 1).data];
}
"""


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_chromium_plays_it(tmp_path: Path, suffix: str):
    """Chromium plays a written video to its end, with the right size, length and colours. No codec was chosen."""
    path = written(tmp_path / f"v{suffix}", FRAMES)
    with chromium() as browser:
        page = browser.new_page()
        kind, data = f"video/{suffix[1:]}", base64.b64encode(path.read_bytes()).decode()
        page.set_content(f'<video muted src="data:{kind};base64,{data}">')
        width, height, seconds, *color = page.evaluate(PLAY)
    assert (width, height) == (62, 36) and seconds == pytest.approx(7 / 12.5, abs=0.02)
    np.testing.assert_allclose(color[:3], FRAMES[-1][20, 40], atol=6)  # the tolerance of decoded video
