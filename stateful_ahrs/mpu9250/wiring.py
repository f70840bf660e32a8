"""How the sensor is connected, and the source that reads it there."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import UsageError
from . import registers as reg
from .chip import Settings
from .chip_source import ChipSource
from .detect import PROTOCOLS
from .i2c import I2cBus, path
from .serial_source import SerialSource
from .simulator import SimulatedMpu9250
from .source import Source

TRANSPORTS = ("sim", "i2c", "serial")
FASTEST = 12_000_000  # bits a second, of any USB chip
ADDRESSES = (reg.ADDRESS, reg.ADDRESS + 1)


@dataclass(frozen=True)
class Wiring:
    """What a user says of the wires; `UsageError` where there are no such."""

    transport: str = "sim"
    i2c_bus: int = 1
    i2c_address: int = reg.ADDRESS
    port: str = "/dev/ttyACM0"
    baudrate: int = 921600
    protocol: str = "auto"

    def __post_init__(self) -> None:
        if self.transport not in TRANSPORTS:
            raise UsageError(
                f"transport must be one of {', '.join(TRANSPORTS)}, got {self.transport!r}."
            )
        if self.i2c_bus < 0:
            raise UsageError(f"i2c_bus must be 0 or more, got {self.i2c_bus}.")
        if self.i2c_address not in ADDRESSES:
            raise UsageError(
                "i2c_address must be 104 (0x68) or, where the board pulls AD0 up, 105 (0x69), got "
                f"{self.i2c_address}."
            )
        if not 0 < self.baudrate <= FASTEST:
            raise UsageError(f"baudrate must be between 1 and {FASTEST}, got {self.baudrate}.")
        if self.protocol not in PROTOCOLS:
            raise UsageError(
                f"protocol must be one of {', '.join(PROTOCOLS)}, got {self.protocol!r}."
            )

    def source(self, settings: Settings, simulator: SimulatedMpu9250 | None = None) -> Source:
        """The source, not yet open; ``simulator`` stands in for the chip of ``sim``."""
        if self.transport == "serial":
            for name in ("fifo", "bypass"):
                if getattr(settings, name):
                    raise UsageError(
                        f"{name} is for transport i2c: a board at a serial port reads its chip "
                        f"itself. Set {name} to false."
                    )
            return SerialSource(self.port, self.baudrate, self.protocol)
        if self.transport == "i2c":
            number = self.i2c_bus
            return ChipSource(lambda: I2cBus(number), settings, self.i2c_address, path(number))
        assert simulator is not None, "transport sim needs a simulator"
        bus = simulator
        return ChipSource(lambda: bus, settings, where="simulated bus")
