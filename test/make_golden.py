"""Makes test/golden: a stream of each serial protocol with damage in it, and what it holds."""

from __future__ import annotations

import json
from pathlib import Path

from boards import BOARDS
from streams import stream

from stateful_ahrs.mpu9250.detect import PARSERS

GOLDEN = Path(__file__).parent / "golden"
FILES = {
    "frame": "frame.bin",
    "razor": "razor.txt",
    "rt_usb text": "rt_usb.txt",
    "rt_usb binary": "rt_usb.bin",
}
DAMAGE = {
    "frame": b"\x07garbage\x00",
    "razor": b"IMU rate set to 100 Hz\r\n",
    "rt_usb text": b"garbage\n",
    "rt_usb binary": b"garbage",
}


def main() -> None:
    """Write the files anew: to be done, and looked at, only when a format changes."""
    GOLDEN.mkdir(exist_ok=True)
    for name, file in FILES.items():
        samples = stream(BOARDS[name](), first=245)
        cut = samples[14][:-9]
        data = b"".join([*samples[:6], DAMAGE[name], *samples[6:10], *samples[12:14], cut])
        data += b"".join(samples[15:])
        parser = PARSERS[name]()
        records = parser.feed(data)
        (GOLDEN / file).write_bytes(data)
        key = file.replace(".", "_") if file.startswith("rt_usb") else file.split(".")[0]
        lines = ",\n".join(json.dumps(record) for record in records)
        content = f'{{"discarded": {parser.discarded}, "records": [\n{lines}\n]}}\n'
        (GOLDEN / f"{key}.json").write_text(content)


if __name__ == "__main__":
    main()
