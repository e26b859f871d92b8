"""Train the network that separates grains, base and vessel from all else, on the pictures of `render.py`.

    python training/grain_classes/train.py FOLDER --minutes 60 --out grain_classes.onnx

A small U-Net.  One of ten groups of five pictures is held out, and their intersection over union of each class is
printed.  The state is kept in `FOLDER/state.pt` after every round, so that an interrupted run goes on; pictures that
were added meanwhile are used from the next round on.
"""

from __future__ import annotations

import argparse
import copy
import math
import time
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import torch
from render import CLASSES
from torch import nn
from torch.nn import functional

WIDTH, HEIGHT = 288, 224  # [px] of the parts of pictures that are shown to the network
BATCH = 12
UPRIGHT = 0.25  # share of the batches that are shown as upright pictures
RATE, DECAY = 2.5e-3, 0.02  # largest step size and weight decay of AdamW
HELD_OUT = 10  # one of ten groups of five pictures, three heaps and two beds
SHARE = 0.995  # of the old mean in the running mean of the weights

Picture = npt.NDArray[np.uint8]


def conv(inside: int, outside: int, stride: int = 1, size: int = 3) -> nn.Sequential:
    way = nn.Conv2d(inside, outside, size, stride, size // 2, bias=False)
    return nn.Sequential(way, nn.BatchNorm2d(outside), nn.ReLU())


class Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = conv(channels, channels)
        self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return functional.relu(x + self.second(self.first(x)))


class Net(nn.Module):
    """U-Net with residual blocks; scores of the classes at half the resolution of the picture."""

    def __init__(self, channels: tuple[int, ...] = (16, 32, 64, 96, 112)) -> None:
        super().__init__()
        blocks = (0, 1, 2, 2, 1)
        inside, downs, ups = 3, [], []
        for outside, count in zip(channels, blocks, strict=True):
            downs.append(nn.Sequential(conv(inside, outside, 2), *(Residual(outside) for _ in range(count))))
            inside = outside
        for outside in channels[-2::-1]:
            ups.append(nn.ModuleList([conv(inside, outside, 1, 1), conv(2 * outside, outside)]))
            inside = outside
        self.downs, self.ups = nn.ModuleList(downs), nn.ModuleList(ups)
        self.wide = conv(channels[-1], channels[-1], 1, 1)  # of the mean of the whole picture
        self.last = nn.Conv2d(channels[0], len(CLASSES), 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        seen = []
        for down in self.downs:
            x = down(x)
            seen.append(x)
        x = x + self.wide(x.mean((2, 3), keepdim=True))
        for (narrow, merge), skip in zip(self.ups, seen[-2::-1], strict=True):
            x = functional.interpolate(narrow(x), scale_factor=2.0, mode="bilinear", align_corners=False)
            x = merge(torch.cat([x, skip], 1))
        return self.last(x)


def varied(
    picture: Picture, kinds: Picture, rng: np.random.Generator, size: tuple[int, int] = (WIDTH, HEIGHT)
) -> tuple[Picture, Picture]:
    """A part of the picture, stretched, mirrored, with other colours, exposure, sharpness, noise and compression.

    `size` is width and height of the part [px].
    """
    tall, wide = kinds.shape
    zoom = math.exp(rng.uniform(math.log(0.62), math.log(1.5))) * math.sqrt(size[0] * size[1] / (wide * tall))
    turn, skew = math.radians(rng.normal(0, 2.0)), math.exp(rng.normal(0, 0.06))
    if rng.random() < 0.5:
        picture, kinds = picture[:, ::-1], kinds[:, ::-1]
    # of a narrower picture some border is shown, else any part that holds its middle region
    free = np.array([wide * zoom - size[0], tall * zoom - size[1]]) / 2
    shift = rng.uniform(-1, 1, 2) * np.abs(free)
    cos, sin = zoom * math.cos(turn), zoom * math.sin(turn)
    map_ = np.array([[cos * skew, -sin, 0.0], [sin, cos / skew, 0.0]])
    map_[:, 2] = np.array(size) / 2 + shift - map_[:, :2] @ (np.array([wide, tall]) / 2)
    way = cv2.INTER_AREA if zoom < 0.8 else cv2.INTER_LINEAR
    mode = cv2.BORDER_REFLECT_101 if rng.random() < 0.5 else cv2.BORDER_REPLICATE
    shown = cv2.warpAffine(np.ascontiguousarray(picture), map_, size, flags=way, borderMode=mode)
    classes = cv2.warpAffine(np.ascontiguousarray(kinds), map_, size, flags=cv2.INTER_NEAREST, borderMode=mode)
    light = shown.astype(np.float32) / 255
    if rng.random() < 0.5:  # dark pictures are stretched before they are shown to the network
        light = light * (rng.uniform(0.6, 1.1) / max(float(np.percentile(light, 99)), 0.02))
    if rng.random() < 0.8:
        light = np.clip(light, 1e-4, 1) ** math.exp(rng.normal(0, 0.35))
        light = (light - 0.5) * math.exp(rng.normal(0, 0.25)) + 0.5 + rng.normal(0, 0.08)
    if rng.random() < 0.6:
        grey = light.mean(axis=2, keepdims=True)
        light = grey + (light - grey) * rng.uniform(0, 1.8)
        light = light * np.exp(rng.normal(0, 0.12, 3)).astype(np.float32)
    if rng.random() < 0.3:
        light = light[..., rng.permutation(3)]
    if rng.random() < 0.25:
        light = cv2.GaussianBlur(light, (0, 0), rng.uniform(0.4, 1.4))
    elif rng.random() < 0.3:
        light = light + rng.uniform(0.2, 1.0) * (light - cv2.GaussianBlur(light, (0, 0), 1.0))
    light = light + rng.normal(size=light.shape) * rng.uniform(0, 0.05) * (rng.random() < 0.6)
    shown = np.clip(255 * light, 0, 255).astype(np.uint8)
    if rng.random() < 0.5:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(30, 95))]
        shown = cv2.imdecode(cv2.imencode(".jpg", np.ascontiguousarray(shown), quality)[1], cv2.IMREAD_COLOR)
    return np.asarray(shown, dtype=np.uint8), np.asarray(classes, dtype=np.uint8)


def held_out(path: Path) -> bool:
    return int(path.stem) // 5 % HELD_OUT == 0


def read(paths: list[Path], known: dict[Path, tuple[Picture, Picture]]) -> list[tuple[Picture, Picture]]:
    for path in paths:
        if path not in known:
            kinds = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            known[path] = (cv2.imread(str(path.with_suffix(".jpg"))), kinds)
    return [known[path] for path in paths]


def tensors(pairs: list[tuple[Picture, Picture]]) -> tuple[torch.Tensor, torch.Tensor]:
    """Pictures as the network takes them, and shares of the classes at half the resolution."""
    shown = torch.from_numpy(np.stack([one for one, _ in pairs]).transpose(0, 3, 1, 2).copy()).float() / 255 - 0.5
    kinds = torch.from_numpy(np.stack([one for _, one in pairs]).astype(np.int64))
    each = functional.one_hot(kinds, len(CLASSES)).permute(0, 3, 1, 2).float()
    return shown.contiguous(memory_format=torch.channels_last), functional.avg_pool2d(each, 2)


def overlap(net: nn.Module, pairs: list[tuple[Picture, Picture]]) -> list[float]:
    """Intersection over union of every class on held-out pictures."""
    net.eval()
    hit, either = np.zeros(len(CLASSES)), np.zeros(len(CLASSES))
    with torch.no_grad():
        for picture, kinds in pairs:
            tall, wide = (side // 32 * 32 for side in kinds.shape)
            shown, _ = tensors([(picture[:tall, :wide], kinds[:tall, :wide])])
            scores = functional.interpolate(net(shown), scale_factor=2.0, mode="bilinear")
            found, true = scores.argmax(1)[0].numpy(), kinds[:tall, :wide]
            for kind in range(len(CLASSES)):
                hit[kind] += np.sum((found == kind) & (true == kind))
                either[kind] += np.sum((found == kind) | (true == kind))
    net.train()
    return (hit / np.maximum(either, 1)).tolist()


def export(net: nn.Module, path: Path) -> None:
    net.eval()
    example = torch.zeros(1, 3, HEIGHT, WIDTH)
    sizes = {"picture": {2: "height", 3: "width"}, "scores": {2: "height2", 3: "width2"}}
    torch.onnx.export(
        net, (example,), str(path), input_names=["picture"], output_names=["scores"], dynamic_axes=sizes, dynamo=False
    )
    net.train()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--round", type=int, default=40, help="steps between two looks at the held-out pictures")
    parser.add_argument("--out", type=Path, default=Path("grain_classes.onnx"))
    asked = parser.parse_args()
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    net = Net().to(memory_format=torch.channels_last)
    mean = copy.deepcopy(net)
    climb = torch.optim.AdamW(net.parameters(), lr=RATE, weight_decay=DECAY)
    state, spent, steps = asked.folder / "state.pt", 0.0, 0
    if state.exists():
        kept = torch.load(state, weights_only=False)
        net.load_state_dict(kept["net"])
        mean.load_state_dict(kept["mean"])
        climb.load_state_dict(kept["climb"])
        spent, steps = kept["spent"], kept["steps"]
        rng = np.random.default_rng(steps)
    known: dict[Path, tuple[Picture, Picture]] = {}
    weight = torch.tensor([1.0, 1.0, 1.5, 1.0]).view(1, -1, 1, 1)
    while spent < 60 * asked.minutes:
        begun, total = time.monotonic(), 0.0
        paths = sorted(asked.folder.glob("*.png"))
        shown = read([path for path in paths if not held_out(path)], known)
        for _ in range(asked.round):
            share = (spent + time.monotonic() - begun) / (60 * asked.minutes)
            for group in climb.param_groups:
                group["lr"] = (
                    RATE * min(1.0, (steps + 1) / 60) * max(0.5 * (1 + math.cos(math.pi * min(share, 1))), 0.01)
                )
            size = (HEIGHT, WIDTH) if rng.random() < UPRIGHT else (WIDTH, HEIGHT)
            picture, kinds = tensors([varied(*shown[k], rng, size) for k in rng.integers(len(shown), size=BATCH)])
            loss = -(weight * kinds * functional.log_softmax(net(picture), 1)).sum(1).mean()
            climb.zero_grad()
            loss.backward()
            climb.step()
            steps += 1
            total += float(loss.detach())
            with torch.no_grad():
                keep = min(SHARE, (1 + steps) / (10 + steps))
                for old, new in zip(mean.state_dict().values(), net.state_dict().values(), strict=True):
                    if old.dtype.is_floating_point:
                        old.mul_(keep).add_(new, alpha=1 - keep)
                    else:
                        old.copy_(new)
        spent += time.monotonic() - begun
        held = read([path for path in paths if held_out(path)], known)[:60]
        unions = " ".join(f"{name} {value:.3f}" for name, value in zip(CLASSES, overlap(mean, held), strict=True))
        print(  # noqa: T201
            f"{spent / 60:5.1f} min, {steps} steps, {len(shown)} pictures: loss {total / asked.round:.4f}; {unions}",
            flush=True,
        )
        kept = {"net": net.state_dict(), "mean": mean.state_dict(), "climb": climb.state_dict()}
        torch.save(kept | {"spent": spent, "steps": steps}, state.with_suffix(".part"))
        state.with_suffix(".part").replace(state)
    export(mean, asked.out)


if __name__ == "__main__":
    main()
