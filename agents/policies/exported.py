"""Networks without a class of their own: TorchScript and ONNX files, and plain torch modules.

    load_exported("policy.onnx")(observations)      # also policy.pt of torch.jit.script or torch.jit.trace

Neither file holds a pickle of Python objects, so loading one executes no Python. TorchScript has operations that read
and write files; an archive whose code calls them is refused unless it is trusted.
"""

from __future__ import annotations

import re
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Space
from numpy.typing import NDArray

from agents.policies.actions import PolicyFailed, one_of, shorten
from agents.policies.spaces import layouts
from flatgym.envs.spaces import observation_space
from flatgym.extras import require
from flatgym.task.observation import OBSERVATIONS

TORCHSCRIPT, ONNX = (".pt", ".pth", ".ts", ".jit", ".torchscript"), (".onnx",)
SUFFIXES = TORCHSCRIPT + ONNX
"""Suffixes of the files."""
FILE_OPERATIONS = re.compile(r"\b(save|load\w*|from_file\w*)\s*\(")
"""Calls of TorchScript's operations on files, torch.save and torch.from_file, in the code of an archive."""
ONNX_TYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64, "tensor(float16)": np.float16}


class Network:
    """A network as a function of observations (n, m) that returns actions (n, 2).

    Args:
        call: the function.
        shape: shape of one observation, if it is known.

    Attributes:
        observation_space: the space of the observations.

    Raises:
        PolicyFailed: if it takes neither features nor states.
    """

    def __init__(self, call: Callable[[NDArray[Any]], NDArray[Any]], shape: tuple[int, ...] | None = None) -> None:
        self._call = call
        self.observation_space = self._tried() if shape is None else _space(shape)

    def __call__(self, observations: NDArray[Any]) -> NDArray[Any]:
        """Return actions (n, 2) for observations of shape (n, m)."""
        return self._call(observations)

    def _tried(self) -> Space[Any]:
        """Return the first space whose observations the network takes."""
        errors = []
        for kind, names in OBSERVATIONS.items():
            try:
                self._call(np.zeros((2, len(names)), dtype=np.float32))
            except Exception as error:  # whatever the network raises
                errors.append(f"{len(names)} {kind}: {shorten(error)}")
            else:
                return observation_space(kind)
        raise PolicyFailed(f"the network takes none of FlatQuad-v0's observations: {'; '.join(errors)}")


def load_exported(path: str | Path, trust: bool = False) -> Network:
    """Return the network in a TorchScript or ONNX file.

    Args:
        path: the file.
        trust: load TorchScript that reads or writes files.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for a file of something else, a damaged one, and one whose observations do not fit.
        ImportError: for ONNX without onnxruntime.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        return _onnx(path) if path.suffix in ONNX else torch_network(_torchscript(path, trust))
    except PolicyFailed as error:
        raise ValueError(f"{path} does not fit: {error}") from error


def torch_network(module: torch.nn.Module) -> Network:
    """Return a torch module as a function of arrays; it is set to evaluation mode."""
    module.eval()
    first = next((value for value in module.parameters() if value.is_floating_point()), torch.zeros(0))
    space = getattr(module, "observation_space", None)

    def call(observations: NDArray[Any]) -> NDArray[Any]:
        with torch.no_grad():
            answer = module(torch.as_tensor(observations).to(first.device, first.dtype))
        return one_of(answer, len(observations))

    return Network(call, getattr(space, "shape", None))


def _torchscript(path: Path, trust: bool) -> torch.nn.Module:
    try:
        with zipfile.ZipFile(path) as file:
            code = {name: file.read(name).decode() for name in file.namelist() if name.endswith(".py")}
    except (zipfile.BadZipFile, zlib.error, EOFError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not a whole TorchScript archive: {error}") from error
    if not code:
        raise ValueError(
            f"{path} is no TorchScript: it holds weights or a pickled module, and no network without its class; write "
            f"torch.jit.script(module).save({path.name!r}) or ONNX, or give module:object"
        )
    called = {found[1] for text in code.values() for found in FILE_OPERATIONS.finditer(text)}
    if called and not trust:
        raise ValueError(
            f"{path} may read or write files: its code calls {', '.join(sorted(called))}; if you trust its author, "
            "--trust loads it"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # TorchScript is read, never written, here
            module: torch.nn.Module = torch.jit.load(path, map_location="cpu")  # type: ignore[no-untyped-call]
    except RuntimeError as error:
        raise ValueError(f"{path} is not TorchScript that this version of torch can load: {shorten(error)}") from error
    return module


def _onnx(path: Path) -> Network:
    require("onnx", "onnxruntime")
    import onnxruntime

    try:
        session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime has an exception class for each kind of damage
        raise ValueError(f"{path} is not an ONNX model that can be run: {shorten(error)}") from error
    inputs = session.get_inputs()
    if len(inputs) != 1 or inputs[0].type not in ONNX_TYPES:
        found = ", ".join(f"{one.name}: {one.type} {one.shape}" for one in inputs)
        raise ValueError(f"{path} must have one input of floating-point observations (n, m), got {found}")
    (seen,), dtype = inputs, ONNX_TYPES[inputs[0].type]
    batch, *shape = seen.shape

    def run(observations: NDArray[Any]) -> NDArray[Any]:
        answers = session.run(None, {seen.name: observations.astype(dtype)})
        return one_of(tuple(answers), len(observations))

    def call(observations: NDArray[Any]) -> NDArray[Any]:
        if batch == 1:  # exported with a fixed batch size
            return np.concatenate([run(one[None]) for one in observations])
        return run(observations)

    return Network(call, tuple(shape) if all(isinstance(size, int) for size in shape) else None)


def _space(shape: tuple[int, ...]) -> Space[Any]:
    """Return the space of observations of a shape."""
    found = layouts(shape)
    if not found:
        known = " or ".join(f"({len(names)},) for {kind}" for kind, names in OBSERVATIONS.items())
        raise PolicyFailed(f"the network takes observations of shape {shape}, and FlatQuad-v0 has {known}")
    return found[0].space
