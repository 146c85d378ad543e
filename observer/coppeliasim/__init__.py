"""CoppeliaSim (V-REP's successor) as a world: its images, its truth and its robots.

Everything goes through the simulator's own client, which only ``connection`` imports, lazily: it
comes with the extra ``coppeliasim``. Tried against a stand-in server that speaks the real
protocol, not against the simulator itself.

Frames
    room: CoppeliaSim's own world, z up, metres.
    sensor: a vision sensor's own axes, z forward, y up, x left.
    camera: OpenCV's, x right, y down, z forward: the sensor turned by 180 degrees about z.
    base: a robot's, x forward, y left, z up; on the floor below the middle of its axle.
"""
