"""Choice of the resolution at which pictures keep up with a camera that moves."""

from __future__ import annotations

_STEPS = (1.0, 0.75, 0.5, 0.375, 0.25, 0.1875, 0.125)  # few sizes, so that the device's memory is used again
_MEMORY = 0.8  # of each measurement, one frame later
_ALIKE = 1e-3  # variance of the pixels' share below which measurements do not tell what a pixel costs
_UPWARDS = 0.75  # of the time allowed, for a finer step: it must not be taken back at once
_WORTH = 1.3  # times what an empty picture costs: coarser pictures would hardly be faster


class Resolution:
    """Chooses the part of the full width and height at which a frame takes no longer than allowed.

    A frame's time is taken as a + b * pixels; both are fitted to what the last frames took. Where a alone is too long,
    as for meshes of very many triangles, the resolution falls only until b does not matter much any more.

    Parameters
    ----------
    seconds : float
        That a frame may take.

    Examples
    --------
    >>> from pyibr.app.live.resolution import Resolution
    >>> resolution = Resolution(1 / 30)
    >>> resolution.took(0.3)  # nine times what is allowed: about a third of the width
    >>> resolution.scale
    0.25
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.scale = 1.0
        self.reset()

    def reset(self) -> None:
        """Forget what frames took: others are drawn from now on."""
        self._sums = [0.0] * 5  # of 1, p, p^2, t, p t: p is the share of the pixels, t the time
        self._slope: float | None = None

    def took(self, seconds: float) -> None:
        """Say how long the frame at `scale` took, and choose the next one's."""
        share = self.scale**2
        new = (1.0, share, share * share, seconds, share * seconds)
        self._sums = [_MEMORY * old + one for old, one in zip(self._sums, new, strict=True)]
        fixed, per_share = self._fitted()
        allowed = max(self.seconds, _WORTH * fixed)
        for step in _STEPS:
            budget = (allowed - fixed) * (_UPWARDS if step > self.scale else 1.0)
            if per_share * step**2 <= budget:
                self.scale = step
                return
        self.scale = _STEPS[-1]

    def _fitted(self) -> tuple[float, float]:
        """a and b, neither below 0."""
        count, p, pp, t, pt = self._sums
        variance = pp / count - (p / count) ** 2
        if variance >= _ALIKE:
            self._slope = max((pt / count - p * t / count**2) / variance, 0.0)
        if self._slope is None or self._slope * p > t:
            return 0.0, t / p
        return (t - self._slope * p) / count, self._slope

    def size(self, full: tuple[int, int]) -> tuple[int, int]:
        """The (width, height) to draw instead of the full one."""
        return max(round(full[0] * self.scale), 1), max(round(full[1] * self.scale), 1)
