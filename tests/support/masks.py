"""A label mask as the node `camera` publishes it."""

import array

from sensor_msgs.msg import Image

SIZE_PX = 256
DLO, TARGET = 1, 2


def hanging_bar():
    """Mask of a bar that hangs down the middle (u 124 to 132, v 40 to 200) and of a target beside it."""
    rows = bytearray(SIZE_PX * SIZE_PX)
    for v in range(40, 200):
        rows[v * SIZE_PX + 124 : v * SIZE_PX + 132] = bytes([DLO] * 8)
        if v >= 180:
            rows[v * SIZE_PX + 200 : v * SIZE_PX + 220] = bytes([TARGET] * 20)
    image = Image(width=SIZE_PX, height=SIZE_PX, encoding="mono8", step=SIZE_PX, data=array.array("B", bytes(rows)))
    image.header.stamp.sec, image.header.frame_id = 5, "somewhere"
    return image
