"""CoppeliaSim (V-REP's successor) as a world: its images, its ground truth and its robots.

Everything goes through the simulator's own client, which comes with the extra ``coppeliasim`` and
is imported only by ``connection``, lazily. This is tested with a stand-in server that speaks the
real protocol, not with the simulator itself.

Frames
    room: CoppeliaSim's own world, z up, metres.
    sensor: a vision sensor's own axes, z forward, y up, x left.
    camera: OpenCV's, x right, y down, z forward: the sensor rotated by 180 degrees about z.
    base: a robot's, x forward, y left, z up; the origin on the floor below the axle's middle.
"""
