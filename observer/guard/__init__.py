"""Guard that keeps robots from driving into things: speed and separation, by sight.

Not a certified safety function. Pure: no thread, no clock, no port; the drive loop calls it.
"""
