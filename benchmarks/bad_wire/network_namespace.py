"""A network namespace of one's own, joined to the outside by a TUN device alone (Linux, root).

The namespace has no name: it ends with the last process in it and the last descriptor of it, so
nothing of it is left behind however its owner ends.
"""

import ctypes
import fcntl
import os
import socket
import struct
import subprocess
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, TypeVar

Result = TypeVar("Result")

TUN_DEVICE = Path("/dev/net/tun")
DEVICE = "wire0"
# A common size of packets on access networks with tunnels.
MTU_BYTES = 1400

# From linux/sched.h, linux/if_tun.h, linux/sockios.h, linux/if.h and linux/route.h.
_CLONE_NEWNET = 0x40000000
_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
_SIOCADDRT, _SIOCSIFFLAGS, _SIOCSIFADDR = 0x890B, 0x8914, 0x8916
_SIOCSIFNETMASK, _SIOCSIFMTU = 0x891C, 0x8922
_IFF_UP, _RTF_UP = 0x1, 0x1
_MULTICAST = ("224.0.0.0", "240.0.0.0")
_NETMASK = "255.255.255.0"


def obstacle() -> str | None:
    """Why this process can make no namespace; None if it can."""
    if not TUN_DEVICE.exists():
        return f"there is no {TUN_DEVICE}"
    if os.geteuid():
        return "only root may make network namespaces"
    try:
        _in_thread(lambda: _unshare())
    except OSError as error:
        return f"the kernel refuses a network namespace: {error.strerror}"
    return None


class NetworkNamespace:
    """A namespace with loopback and one device of address `address`/24, which also has multicast.

    tun: descriptor of the device, non-blocking: what the namespace sends is read from it, one IP
        packet at a time, what is written to it the namespace receives.
    Raises `OSError` where `obstacle` names one.
    """

    def __init__(self, address: str, mtu_bytes: int = MTU_BYTES) -> None:
        self.tun, self._namespace = _in_thread(lambda: _made(address, mtu_bytes))

    def run(
        self, command: Sequence[str], output: IO[bytes], environment: dict[str, str] | None = None
    ) -> subprocess.Popen[bytes]:
        """Start `command` in the namespace, in a process group of its own.

        output: gets its standard output and error.  environment: None: that of this process.
        """

        def start() -> subprocess.Popen[bytes]:
            self._enter()
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )

        return _in_thread(start)

    def readdress(self, address: str) -> None:
        """Give the device the address `address` instead of the one that it has."""

        def change() -> None:
            self._enter()
            _set_address(address)

        _in_thread(change)

    def close(self) -> None:
        """Let go of device and namespace."""
        os.close(self.tun)
        os.close(self._namespace)

    def _enter(self) -> None:
        """Put the calling thread, and processes that it starts, into the namespace."""
        _check(_libc().setns(self._namespace, _CLONE_NEWNET))


def _in_thread(function: Callable[[], Result]) -> Result:
    """The result of `function`, run in a thread that ends: a namespace is a thread's."""
    results: list[Result] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            results.append(function())
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    if errors:
        raise errors[0]
    return results[0]


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _check(status: int) -> None:
    if status:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _unshare() -> None:
    _check(_libc().unshare(_CLONE_NEWNET))


def _made(address: str, mtu_bytes: int) -> tuple[int, int]:
    """Descriptors of the device and of the namespace of the calling thread, which is new."""
    _unshare()
    namespace = os.open(f"/proc/self/task/{threading.get_native_id()}/ns/net", os.O_RDONLY)
    tun = os.open(TUN_DEVICE, os.O_RDWR | os.O_NONBLOCK)
    try:
        name = DEVICE.encode()
        fcntl.ioctl(tun, _TUNSETIFF, struct.pack("16sH22x", name, _IFF_TUN | _IFF_NO_PI))
        _control(_SIOCSIFMTU, DEVICE, struct.pack("i", mtu_bytes))
        for device in ("lo", DEVICE):
            _control(_SIOCSIFFLAGS, device, struct.pack("h", _IFF_UP))
        _set_address(address)
    except OSError:
        os.close(tun)
        os.close(namespace)
        raise
    return tun, namespace


def _set_address(address: str) -> None:
    _control(_SIOCSIFADDR, DEVICE, _socket_address(address))
    _control(_SIOCSIFNETMASK, DEVICE, _socket_address(_NETMASK))
    device = ctypes.create_string_buffer(DEVICE.encode())
    target, mask = map(_socket_address, _MULTICAST)
    # struct rtentry: target, gateway, mask, flags, metric and device are of interest.
    route = struct.pack(
        "@L16s16s16sHhLPhPLLH",
        *(0, target, b"", mask, _RTF_UP, 0, 0, 0, 0),
        *(ctypes.addressof(device), 0, 0, 0),
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        fcntl.ioctl(control, _SIOCADDRT, route)


def _control(request: int, device: str, value: bytes) -> None:
    """Set a property of a device of the calling thread's namespace."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        fcntl.ioctl(control, request, struct.pack("16s24s", device.encode(), value))


def _socket_address(address: str) -> bytes:
    return struct.pack("=HH4s8x", socket.AF_INET, 0, socket.inet_aton(address))
