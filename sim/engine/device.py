"""Names of the devices on which the engine can run; importing this module does not start Taichi."""

import os
from typing import Literal, get_args

Device = Literal["cpu", "cuda", "auto"]
DEVICES: tuple[Device, ...] = get_args(Device)
VARIABLE = "RIGTWIN_DEVICE"  # environment variable that names the device where nothing else does


def usual_device() -> Device:
    """Device where none is named: that of the environment variable, else the CPU; `backend.start` checks it."""
    return os.environ.get(VARIABLE) or "cpu"  # type: ignore[return-value]
