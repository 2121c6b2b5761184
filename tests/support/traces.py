"""Trace which files of ours a piece of work enters."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any


def entered_files(work: Callable[[], Any], packages: tuple[ModuleType, ...]) -> list[str]:
    """The files of `packages` that the calls of `work` enter, in order."""
    homes, entered = tuple(f"{Path(str(p.__file__)).parent}{os.sep}" for p in packages), list[str]()

    def watch(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(homes):
            entered.append(frame.f_code.co_filename)

    sys.setprofile(watch)
    try:
        work()
    finally:
        sys.setprofile(None)
    return entered
