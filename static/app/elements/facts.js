/** Facts declared in the code: made by tools/packaging/page_facts.py. */

/** Half of the 95 % interval, in standard deviations. */
export const SIGMAS_95 = 1.96;

/** A true body that is faster counts as moving, m/s. */
export const MOVING_MPS = 0.05;

/** A true body of which the camera sees this share or more is in sight, 0 to 1. */
export const VISIBLE_SHARE = 0.5;

/** Half the angle of a sonar's cone, until the guard's parameters are known. */
export const SONAR_HALF_ANGLE_DEG = 15;
