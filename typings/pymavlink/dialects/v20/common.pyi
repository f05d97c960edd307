class MAVLink:
    seq: int

class MAVLink_message:  # noqa: N801
    def pack(self, mav: MAVLink) -> bytes: ...
