"""What a sensor shows of a room, before it is built."""

from dataclasses import replace

import omnimirror as om
from omnimirror.imagers import Imager

sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(640, 640, 8.32))
om.write_image("a_room.png", om.take_picture(sensor, om.Room(), samples=8))
