"""Names of the devices on which the engine can run; importing this module does not start Taichi."""

from typing import Literal, get_args

Device = Literal["cpu", "cuda", "auto"]
DEVICES: tuple[Device, ...] = get_args(Device)
