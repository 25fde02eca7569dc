"""Choice of a resolution at which drawing keeps up with a moving camera."""

from __future__ import annotations

_STEPS = (1.0, 0.75, 0.5, 0.375, 0.25, 0.1875, 0.125)  # few sizes, so that device memory can be reused
_MEMORY = 0.8  # factor by which the weight of a measurement falls with each frame
_ALIKE = 1e-3  # variance of the fraction of pixels below which the cost of a pixel cannot be fitted
_UPWARDS = 0.75  # fraction of the allowed time that a finer step may take, so that it is not reverted immediately
_WORTH = 1.3  # least allowed time, in costs of an empty picture: in less, coarser pictures are hardly faster


class Resolution:
    """Chooses the scale of width and height at which a frame takes no longer than allowed.

    The time of a frame is modelled as a + b * pixels, fitted to the last frames. If `a` alone is too long, as for
    meshes of very many triangles, the resolution falls only until the pixels hardly matter.

    Parameters
    ----------
    seconds : float
        Allowed time of a frame.
    least : float
        Least scale, up to 1, even if frames take longer.

    Examples
    --------
    >>> from pyibr.app.live.resolution import Resolution
    >>> resolution = Resolution(1 / 30)
    >>> resolution.took(0.3)  # nine times what is allowed: about a third of the width
    >>> resolution.scale
    0.25
    """

    def __init__(self, seconds: float, least: float = 0.0) -> None:
        self.seconds = seconds
        self._steps = [step for step in _STEPS if step >= least]
        self.scale = 1.0
        self.reset()

    def reset(self) -> None:
        """Forget earlier timings, for a change of the scene."""
        self._sums = [0.0] * 5  # sums of 1, p, p^2, t, p t: p is the fraction of the pixels, t the time
        self._slope: float | None = None

    def took(self, seconds: float) -> None:
        """Add the time of the frame at `scale`, and choose the next scale."""
        share = self.scale**2
        new = (1.0, share, share * share, seconds, share * seconds)
        self._sums = [_MEMORY * old + one for old, one in zip(self._sums, new, strict=True)]
        fixed, per_share = self._fitted()
        allowed = max(self.seconds, _WORTH * fixed)
        for step in self._steps:
            budget = (allowed - fixed) * (_UPWARDS if step > self.scale else 1.0)
            if per_share * step**2 <= budget:
                self.scale = step
                return
        self.scale = self._steps[-1]

    def _fitted(self) -> tuple[float, float]:
        """Fit a and b, both at least 0."""
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
