"""The attitude in the axes of ships and aircraft, and what of it may be used.

A message has the body x forward, y left, z up in a world of x east, y north, z up, angles right-handed (core/euler.py,
"zyx"). Ships and aircraft have x forward, y to starboard, z down in north, east, down. Changing both sides turns
Rz(yaw) Ry(pitch) Rx(roll) into Rz(90 deg - yaw) Ry(-pitch) Rx(roll):

| ours                             | theirs                            | positive                      |
| -------------------------------- | --------------------------------- | ----------------------------- |
| roll about x                     | roll = roll                       | starboard down                |
| pitch about y                    | pitch = -pitch                    | bow up                        |
| yaw, "magnetic" or "true"        | heading = 90 deg - yaw, 0 to 360  | clockwise from north          |
| yaw, "relative"                  | yaw = -yaw, and no heading        | clockwise from where it began |
| rate about x, y, z of the body   | x, -y, -z                         | as the angles                 |
| rate about z of the world        | rate of turn = -rate              | to starboard                  |
| quaternion w, x, y, z            | w, x, -y, -z, turned by 90 deg    | forward, starboard, down to   |
|                                  | about down where north is known   | north, east, down             |
"""

from __future__ import annotations

from math import cos, hypot, inf, isfinite, radians, sin, sqrt, tan
from typing import NamedTuple

from quavelet.sinks.message import Four, Message, Three

NO_ATTITUDE = frozenset({"settling", "stuck"})
"""With one of these roll and pitch are not to be used."""
NO_RATE = NO_ATTITUDE | {"bias_unknown", "gyro_clipped"}
NO_HEADING = NO_ATTITUDE | {"field_lost", "field_disturbed", "heading_suspect"}
HEADING_SIGMA_DEG = 30.0
"""A heading less sure than this is none: of a body on its bow or stern, of a magnetometer long disturbed."""
_LIMIT_DEG = 180.0


class ShipAttitude(NamedTuple):
    """A message in the axes of ships.

    roll_deg, pitch_deg, yaw_deg  yaw -180 to 180: the heading, or from where it began
    rate_rad_s     about forward, starboard, down
    turn_rad_s     of the bow to starboard, about the vertical
    sigma_deg      one sigma of roll, pitch, heading; at most 180
    attitude_ok    roll and pitch may be used
    rate_ok        the rates may be used
    heading_deg    0 to 360 from north, None where it is not known or doubtful
    """

    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    rate_rad_s: Three
    turn_rad_s: float
    sigma_deg: Three
    attitude_ok: bool
    rate_ok: bool
    heading_deg: float | None


def ship_attitude(message: Message) -> ShipAttitude | None:
    """The message in ships' axes; None where an angle or a rate is not a number."""
    x, y, z = message.gyro_rad_s
    if not all(map(isfinite, (message.roll_deg, message.pitch_deg, message.yaw_deg, x, y, z, *message.q))):
        return None
    turned = -message.yaw_deg if message.yaw == "relative" else 90.0 - message.yaw_deg
    sigma = _sigma(message)
    flags = set(message.flags)
    known = message.yaw != "relative" and not flags & NO_HEADING and sigma[2] <= HEADING_SIGMA_DEG
    return ShipAttitude(
        roll_deg=message.roll_deg,
        pitch_deg=-message.pitch_deg,
        yaw_deg=180.0 - (180.0 - turned) % 360.0,
        rate_rad_s=(x, -y, -z),
        turn_rad_s=-_about_the_vertical(message.q, message.gyro_rad_s),
        sigma_deg=sigma,
        attitude_ok=not flags & NO_ATTITUDE,
        rate_ok=not flags & NO_RATE,
        heading_deg=turned % 360.0 if known else None,
    )


def ship_quaternion(message: Message) -> Four:
    """The quaternion FRD to NED, w >= 0, or to a level frame that begins where yaw did."""
    w, x, y, z = message.q
    p: Four = (w, x, -y, -z)
    if message.yaw != "relative":
        w, x, y, z = p
        h = sqrt(0.5)  # A quarter turn about down, to the left of the product: heading = 90 deg - yaw.
        p = (h * (w - z), h * (x - y), h * (y + x), h * (z + w))
    sign = -1.0 if p[0] < 0.0 else 1.0
    return sign * p[0], sign * p[1], sign * p[2], sign * p[3]


def _about_the_vertical(q: Four, rate: Three) -> float:
    """The world's z component of a body vector."""
    w, x, y, z = q
    return 2 * (x * z - w * y) * rate[0] + 2 * (y * z + w * x) * rate[1] + (w * w - x * x - y * y + z * z) * rate[2]


def _sigma(message: Message) -> Three:
    """Sigma of roll, pitch, heading from that about the world's axes: the derivative of the angles at the attitude."""
    x, y, z = (s if isfinite(s) else inf for s in message.sigma_deg)
    if inf in (x, y, z):
        return _LIMIT_DEG, _LIMIT_DEG, _LIMIT_DEG
    yaw, pitch = radians(message.yaw_deg), radians(message.pitch_deg)
    ahead, across = hypot(cos(yaw) * x, sin(yaw) * y), hypot(sin(yaw) * x, cos(yaw) * y)
    steep = max(cos(pitch), 1e-6)
    of = ahead / steep, across, hypot(z, tan(pitch) * ahead)
    return min(of[0], _LIMIT_DEG), min(of[1], _LIMIT_DEG), min(of[2], _LIMIT_DEG)
