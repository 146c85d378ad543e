/** Facts declared in the code: made by tools/packaging/page_facts.py. */

/** Half of the 95 % interval, in standard deviations. */
export const SIGMAS_95 = 1.96;

/** A true body that is faster counts as moving, m/s. */
export const MOVING_MPS = 0.05;

/** A true body of which the camera sees this share or more is in sight, 0 to 1. */
export const VISIBLE_SHARE = 0.5;

/** Half the angle of a sonar's cone, until the guard's parameters are known. */
export const SONAR_HALF_ANGLE_DEG = 15;

/** The server stops a robot after this long without a sign of its operator, s. */
export const COMMAND_FRESH_S = 0.25;

/** The server sends something on a socket at least this often, s. */
export const HEARTBEAT_S = 0.2;

/** What is shown is stale after this time, s. */
export const STALE_AFTER_S = 1;

/** Number of entries of the log that the server keeps. */
export const LOG_LENGTH = 500;

/** Colour of an obstacle by its state, in every image and view of the scene. */
export const OBSTACLE_COLOURS = {
  "moving": "#e22c2c",
  "in_place": "#cd7000",
  "stopped": "#0085c8",
  "coasting": "#808080",
};

/** Robot models whose constants are known, and their names for people. */
export const ROBOT_MODELS = {
  "p3dx-sh": "Pioneer P3-DX, SH controller",
  "p3dx": "Pioneer P3-DX, older",
  "amigo-sh": "AmigoBot, SH controller",
  "amigo": "AmigoBot, older",
};

/** The server rejects a goal farther away, metres. */
export const FARTHEST_GOAL_M = 20;

/** Number of states of a cell of a local map, from 0. */
export const MAP_STATES = 3;

/** State of a free cell of a local map. */
export const MAP_FREE = 1;

/** State of a blocked cell of a local map. */
export const MAP_BLOCKED = 2;

/** Minimum inner corners of a board in each direction. */
export const MIN_SIDE_CORNERS = 3;

/** Maximum inner corners of a board in each direction. */
export const MAX_SIDE_CORNERS = 30;

/** Minimum side of a board's squares, mm. */
export const MIN_SQUARE_MM = 2;

/** Maximum side of a board's squares, mm. */
export const MAX_SQUARE_MM = 500;

/** Inner corners across of a board that fits on A4. */
export const A4_COLUMNS = 9;

/** Inner corners down of a board that fits on A4. */
export const A4_ROWS = 6;

/** Side of its squares, mm. */
export const A4_SQUARE_MM = 21;

/** Length of the bar printed beside a calibration board, mm. */
export const BAR_MM = 100;

/** The server warns of a higher epipolar error, px. */
export const ROW_WARN_PX = 0.5;

/** Lowest playback rate, times the recorded speed. */
export const SLOWEST_RATE = 0.1;

/** Highest playback rate, times the recorded speed. */
export const FASTEST_RATE = 4;

/** No curve is drawn over a stretch this many times its usual step. */
export const GAP_STEPS = 3;

/** Tag of the runs that a comparison of methods keeps. */
export const COMPARISON_TAG = "comparison";

/** First field of a preset's file. */
export const PRESET_FORMAT = "dynamic-observer preset";

/** Maximum number of characters in a name. */
export const LONGEST_NAME = 100;

/** Maximum number of characters in the description of a preset. */
export const LONGEST_PRESET_HELP = 300;

/** A socket whose session has ended is closed with this code. */
export const SESSION_OVER = 4401;

/** Notice for a browser with read-only access. */
export const WATCHING_ONLY = "This link is read-only. Ask for an operator link to change anything.";
