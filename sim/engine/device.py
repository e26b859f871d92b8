"""The devices that the engine may run on, told without starting it."""

from typing import Literal, get_args

Device = Literal["cpu", "cuda", "auto"]
DEVICES: tuple[Device, ...] = get_args(Device)
