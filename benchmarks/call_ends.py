"""The ends of a measured call: how they are started, and what terminals and pages are told."""

import json
import subprocess
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, TypeVar

import aiohttp

from benchmarks.command import PROGRAM
from shared_model.errors import UserError

Found = TypeVar("Found")
End = subprocess.Popen[str]
# What an end says in the terminal with the address of its page.
PAGE = "page is at"


def start_end(stack: ExitStack, *arguments: str) -> End:
    """Start one end of a call, which is ended with the stack."""
    end = stack.enter_context(
        subprocess.Popen([*PROGRAM, "call", *arguments], stderr=subprocess.PIPE, text=True)
    )
    stack.callback(end.terminate)
    return end


def page_of(end: End) -> str:
    """The address of its page, once that is there.  Raises `UserError` if the end has ended."""
    return line_with(end, PAGE).split()[-1]


def line_with(end: End, what: str) -> str:
    """The next line in its terminal that says this.  Raises `UserError` if it has ended."""
    assert end.stderr is not None
    for line in end.stderr:
        if what in line:
            return line
    raise UserError("an end of the call has ended")


async def first_told(page: str, find: Callable[[dict[str, Any]], Found | None]) -> Found:
    """The first that `find` finds in what a page is told.  Raises `UserError` if its end ends."""
    headers = {"Origin": page.rsplit("/", 2)[0]}
    async with (
        aiohttp.ClientSession() as client,
        client.ws_connect(f"{page}ws", headers=headers, max_msg_size=0) as socket,
    ):
        async for message in socket:
            if message.type is aiohttp.WSMsgType.TEXT:
                found = find(json.loads(message.data))
                if found is not None:
                    return found
    raise UserError("an end of the call has ended")
