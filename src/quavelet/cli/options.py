"""The options that several commands share, and the settings they give."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from quavelet.core.errors import SettingsError
from quavelet.settings import LoadedSettings, Settings, Value, load_settings
from quavelet.settings.web import page_address

Bus = Annotated[str | None, typer.Option("--bus", help="linux:N for /dev/i2c-N, or fake:NAME.", show_default=False)]
Address = Annotated[
    str | None, typer.Option("--address", help="0x68, or 0x69 with AD0 high.", show_default=False, metavar="ADDRESS")
]
AcceptId = Annotated[
    str | None,
    typer.Option(
        "--accept-id",
        help="Drive a chip with this WHO_AM_I, which quavelet does not know, as an MPU-6500.",
        show_default=False,
        metavar="0xNN",
    ),
]
Config = Annotated[Path | None, typer.Option("--config", help="A TOML settings file.", show_default=False)]
Json = Annotated[bool, typer.Option("--json", help="JSON lines even on a terminal.")]
Duration = Annotated[float | None, typer.Option("--duration", help="Stop after this many seconds.", min=0.01)]
Record = Annotated[Path | None, typer.Option("--record", help="Write a recording to this file.", show_default=False)]
WaitForDevice = Annotated[
    bool, typer.Option("--wait-for-device", help="Keep trying while the chip does not answer at the start.")
]
Mcap = Annotated[Path | None, typer.Option("--mcap", help="Write an MCAP file for Foxglove, too.", show_default=False)]
Web = Annotated[bool, typer.Option("--web", help="Serve the live page, on this machine only unless [web] says more.")]
Port = Annotated[
    int | None, typer.Option("--port", help="The port of the live page.", min=0, max=65535, show_default=False)
]
VirtualTime = Annotated[
    bool, typer.Option("--virtual-time", help="On a fake bus: as fast as the machine can, on a clock of its own.")
]


def settings_of(
    bus: str | None,
    address: str | None,
    config: Path | None,
    accept_id: str | None = None,
    *,
    wait_for_device: bool = False,
    web: bool = False,
    port: int | None = None,
) -> LoadedSettings:
    """The settings with these options on top. Raises SettingsError; what is no number is a usage error, and so is a
    port where no page is asked for."""
    options: dict[str, Value] = {}
    if bus is not None:
        options["bus.name"] = bus
    if address is not None:
        options["bus.address"] = _number(address, "is not an address: write it as 0x68", "--address")
    if accept_id is not None:
        options["bus.accept_id"] = _number(accept_id, "is not a WHO_AM_I: write it as 0x7d", "--accept-id")
    if wait_for_device:
        options["service.wait_for_device"] = True
    loaded = load_settings(config, options=options)
    if not web and port is None:
        return loaded
    listen = loaded.settings.web.listen
    if not web and not listen:
        raise typer.BadParameter("it is that of the page: give --web too", param_hint="--port")
    return load_settings(config, options={**options, "web.listen": page_address(listen, port=port)})


def _number(text: str, complaint: str, option: str) -> int:
    try:
        return int(text, 0)
    except ValueError:
        raise typer.BadParameter(f"'{text}' {complaint}", param_hint=option) from None


def on_virtual_time(settings: Settings, wanted: bool) -> bool:
    """`wanted`. Raises SettingsError where the bus is not a fake one: real wires keep real time."""
    if wanted and not settings.bus.name.startswith("fake:"):
        raise SettingsError(f"--virtual-time needs a fake bus, {settings.bus.name} keeps real time: leave it out")
    return wanted
