#!/usr/bin/env python3
"""Prints every pose that waymarkd publishes.

Needs LCM's Python module, which Debian 12 does not package (pip install lcm), and the generated
types beside this file:

    lcm-gen -p /usr/share/waymark/lcmtypes/waymark/*.lcm
    python3 pose_listener.py [URL] [CHANNEL]
"""

import math
import sys

import lcm

from waymark import pose_t


def sigma(covariance):
    """Of the position, metres. Row-major 6x6 of (dp, dtheta): xx, yy and zz are 0, 7 and 14."""
    return math.sqrt(max(covariance[0], covariance[7], covariance[14]))


def on_pose(_channel, data):
    pose = pose_t.decode(data)
    if pose.source == pose_t.SOURCE_NONE:
        print(f"no pose: {pose.reason}")
        return
    x, y, z = pose.p_w_c
    # In the world, for whoever plans a way; relative to the markers in view, for whoever docks.
    print(
        f"{pose.sequence:8d}  x {x:7.3f}  y {y:7.3f}  z {z:7.3f} m  "
        f"+- {1e3 * sigma(pose.covariance):4.1f} mm  "
        f"({1e3 * sigma(pose.view_covariance):4.1f} in view)  "
        f"{1e-6 * pose.latency_ns:.1f} ms old"
    )


def main():
    url = sys.argv[1] if len(sys.argv) > 1 else "udpm://239.255.76.67:7667?ttl=0"
    channel = sys.argv[2] if len(sys.argv) > 2 else "WAYMARK_POSE"
    bus = lcm.LCM(url)
    bus.subscribe(channel, on_pose)
    try:
        while True:
            bus.handle()
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
