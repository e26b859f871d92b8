"""Timestamp jitter: frames are not evenly spaced, so the noise along the path grows with the speed.

Formula: sigma^2 = sigma_0^2 + (v tau)^2 along the path

tau is `std`, v the speed; the effect widens the noise and moves no position.

Parameters:
- `std` [s], 0 to 0.05, typically 0.0002: standard deviation of a frame's time

Source: camera clock
"""

from rigtwin.sim.effects.effect import Effect, Parameter

EFFECT = Effect(
    name="timestamp_jitter",
    title="timestamp jitter",
    kind="measurement",
    rigs=("drop", "pendulum", "double", "slide", "roll"),
    parameters=(Parameter("std", "s", 0.0, 0.05, 2e-4, least=1e-5, meaning="standard deviation of a frame's time"),),
    equation="sigma^2 = sigma_0^2 + (v tau)^2 along the path",
    source="camera clock",
    synonyms=("jitter", "frame timing", "irregular frames", "time stamp noise", "timing noise"),
    geometry="jitter",
    splits="film a light that blinks at a steady rate: the noise of its times is the jitter",
)
