"""The faults that a person is offered: each as one sentence, and as the text that makes it happen now."""

from __future__ import annotations

from quavelet.bus.protocol import OfferedFault

CATALOGUE = (
    OfferedFault("unplugged", "Pull the plug for half a second", "unplugged for=0.5"),
    OfferedFault("unplugged-long", "Pull the plug for three seconds", "unplugged for=3"),
    OfferedFault("brown-out", "Let the chip's supply fail for a moment: it forgets all it was told", "brown-out"),
    OfferedFault("asleep", "Let the chip fall asleep", "asleep"),
    OfferedFault("overflow", "Fill the chip's memory, as if the computer had been too busy to read it", "overflow"),
    OfferedFault("slip", "Lose three bytes in the chip's memory, so that all after them are misplaced", "slip bytes=3"),
    OfferedFault("zeros", "Let the wires read nothing but zeros for 0.3 s", "zeros for=0.3"),
    OfferedFault("disturbed", "Disturb the next twelve transfers on the wires", "eio n=12"),
    OfferedFault("high-bit", "Flip a high bit of one sample on its way", "flip register=0x74 byte=8 bit=6"),
    OfferedFault("low-bit", "Flip a low bit of one sample on its way", "flip register=0x74 byte=9 bit=2"),
    OfferedFault("frozen", "Freeze the chip: the same sample again and again for three seconds", "frozen for=3"),
    OfferedFault(
        "temperature", "Let the chip's thermometer read 30 degC too much for a second", "temperature for=1 by=30"
    ),
    OfferedFault("range", "Change the gyroscope's range behind the driver's back", "changed register=0x1b value=0x18"),
)
