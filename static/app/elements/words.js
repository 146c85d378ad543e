/** Numbers and observations in words. Pure functions. */

import { MOVING_MPS, OBSTACLE_COLOURS, SIGMAS_95, VISIBLE_SHARE } from "./facts.js";

/** @import { LiveLine, ObstacleEntry, TrueBodyEntry } from "../contract" */
/** @import { LastSeen, Sighting } from "./last-seen.js" */

const STRAIGHT_RAD = (8 * Math.PI) / 180;
// An obstacle slower than this has no heading worth naming.
const NO_HEADING_BELOW_MPS = 0.02;

/**
 * @param {number | null | undefined} value
 * @param {number} digits after the point
 */
export function fixed(value, digits) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  // No -0.00: the sign of a value rounded to zero means nothing.
  return withMinus(value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1"));
}

/** Write the sign of a negative number as a minus, not as a hyphen. @param {number | string} value */
export function withMinus(value) {
  return String(value).replace(/^-/, "−");
}

/** Half of the 95 % interval of a value, shown after every ±. @param {number} std one standard deviation */
export function half95(std) {
  return SIGMAS_95 * std;
}

/** @param {Pick<ObstacleEntry, "speed" | "speed_std">} obstacle @returns {string} without unit */
export function speedWithBand({ speed, speed_std }) {
  return speed_std === null
    ? fixed(speed, 2)
    : `${fixed(speed, 2)} ± ${fixed(half95(speed_std), 2)}`;
}

/** What each state of an obstacle is called, in legends and, capitalized, in sentences. */
export const STATE_WORDS = {
  moving: "moving",
  in_place: "moving in place",
  stopped: "stopped",
  coasting: "out of view",
};

/**
 * Return the label beside an obstacle's box without its number, as observer/obstacle_labels.py does
 * for live images.
 *
 * @param {Pick<ObstacleEntry, "motion" | "speed" | "speed_std">} obstacle
 */
export function boxLabel(obstacle) {
  return obstacle.motion === "in_place" ? "in place" : `${speedWithBand(obstacle)} m/s`;
}

/** @param {number} bearing radians, positive to the right @returns {string} as in "ahead" */
export function bearingInWords(bearing) {
  const side = bearing > 0 ? "right" : "left";
  const size = Math.abs(bearing);
  if (size < STRAIGHT_RAD) return "ahead";
  return size < 3 * STRAIGHT_RAD ? `ahead to the ${side}` : `off to the ${side}`;
}

/**
 * Say which way an obstacle is heading, as seen from the camera.
 *
 * @param {ObstacleEntry} obstacle
 * @param {LiveLine["pose"]} pose of the camera in the world
 * @returns {string} as in "to the left and towards the camera", empty where it is not known
 */
export function headingInWords(obstacle, pose) {
  if (!obstacle.velocity || !pose) return "";
  const [x = 0, , z = 0] = rotateInverse(pose.orientation_wxyz, obstacle.velocity);
  const length = Math.hypot(x, z);
  if (length < NO_HEADING_BELOW_MPS) return "";
  const parts = [];
  // A component is named if it is at least tan(22.5 degrees) times the other.
  if (Math.abs(x) > 0.414 * Math.abs(z)) parts.push(x > 0 ? "to the right" : "to the left");
  if (Math.abs(z) > 0.414 * Math.abs(x))
    parts.push(z > 0 ? "away from the camera" : "towards the camera");
  return parts.join(" and ");
}

/**
 * The headline of the page. Only what is in view now is said to move.
 *
 * @param {LiveLine} line
 * @param {TrueBodyEntry[]} truth
 * @param {Pick<LastSeen, "of">} lastSeen
 * @returns {{text: string, id: number | null, tone: "moving" | "calm" | "lost"}}
 */
export function headline(line, truth, lastSeen) {
  if (line.status === "lost") {
    const why = line.reasons[0] ? `: ${line.reasons[0]}` : "";
    return { text: `Camera motion lost${why}.`, id: null, tone: "lost" };
  }
  const inView = line.obstacles.filter((o) => o.state !== "coasting");
  const moving = inView.filter((o) => o.motion === "moving");
  const nearest = nearestOf(moving);
  if (nearest) {
    return {
      text: movingLine(nearest, moving.length - 1, line, truth),
      id: nearest.id,
      tone: "moving",
    };
  }
  const waving = inView.find((o) => o.motion === "in_place");
  const standing = inView[0];
  const left = nearestOf(
    line.obstacles.filter((o) => !inView.includes(o) && o.motion !== "stopped"),
  );
  const missed = truth.find(
    (body) =>
      body.role !== "observer" &&
      body.speed > MOVING_MPS &&
      (body.visible === null || body.visible >= VISIBLE_SHARE),
  );
  let text = standing
    ? `No motion in view; obstacle ${standing.id} has stopped.`
    : "No motion in view.";
  if (left) text = leftLine(left.id, lastSeen.of(left.id));
  if (waving) {
    text = `Obstacle ${waving.id} moves in place, ${fixed(waving.range, 1)} m ${bearingInWords(waving.bearing)}.`;
  }
  if (missed) {
    text = `No motion detected — ground truth: ${missed.name} moves at ${fixed(missed.speed, 2)} m/s.`;
  }
  return { text, id: null, tone: "calm" };
}

/** @param {ObstacleEntry[]} obstacles */
function nearestOf(obstacles) {
  return [...obstacles].sort((a, b) => a.range - b.range)[0];
}

/**
 * @param {number} id
 * @param {Sighting | null} sighting
 */
function leftLine(id, sighting) {
  if (!sighting) return `Obstacle ${id} is out of view.`;
  const ago = `${fixed(sighting.ago_s, 1)} s ago`;
  return `Obstacle ${id} left the view ${ago}, last measured at ${speedWithBand(sighting)} m/s.`;
}

/**
 * Say what is known of an obstacle that is out of view, without what is only predicted.
 *
 * @param {Sighting | null} sighting
 */
export function outOfViewInWords(sighting) {
  if (!sighting) return "Out of view. Position and speed are predicted.";
  const ago = `${fixed(sighting.ago_s, 1)} s ago`;
  return `Out of view. Last measured at ${speedWithBand(sighting)} m/s, ${ago}.`;
}

/**
 * @param {ObstacleEntry} obstacle
 * @param {number} others how many more move
 * @param {LiveLine} line
 * @param {TrueBodyEntry[]} truth
 */
function movingLine(obstacle, others, line, truth) {
  const heading = headingInWords(obstacle, line.pose);
  const body = truth.find((b) => b.track_id === obstacle.id);
  return [
    `Obstacle ${obstacle.id} moves at ${speedWithBand(obstacle)} m/s`,
    heading && ` ${heading}`,
    `, ${fixed(obstacle.range, 1)} m ${bearingInWords(obstacle.bearing)}`,
    body && ` — ground truth ${fixed(body.speed, 2)} m/s`,
    others > 0 && `; ${others === 1 ? "one more moves" : `${others} more move`}`,
  ]
    .filter(Boolean)
    .join("");
}

/**
 * @param {number | null} seconds the length of a run
 * @returns {string} as in "1 min 12.3 s", in reports too
 */
export function duration(seconds) {
  if (seconds === null) return "–";
  const tenths = Math.round(10 * seconds);
  const minutes = Math.floor(tenths / 600);
  const hours = Math.floor(minutes / 60);
  return [
    hours > 0 && `${hours} h`,
    minutes > 0 && `${minutes % 60} min`,
    `${((tenths % 600) / 10).toFixed(1)} s`,
  ]
    .filter(Boolean)
    .join(" ");
}

/** @param {number} seconds since something was made @returns {string} as in "85 ms" and "2 min 4.0 s" */
export function age(seconds) {
  return seconds < 1 ? `${fixed(1000 * seconds, 0)} ms` : duration(seconds);
}

/**
 * @param {number} count
 * @param {string} one as in "run"
 */
export function counted(count, one) {
  return `${count} ${one}${count === 1 ? "" : "s"}`;
}

/** @param {string} iso @returns {string} in the reader's language, short */
export function when(iso) {
  const date = new Date(iso);
  return Number.isNaN(date.getTime())
    ? iso
    : date.toLocaleString(undefined, { dateStyle: "short", timeStyle: "medium" });
}

/** @param {Pick<ObstacleEntry, "state" | "motion">} obstacle @returns {string} its colour in images and in the scene */
export function stateColour({ state, motion }) {
  return OBSTACLE_COLOURS[state === "coasting" ? state : motion];
}

/** @param {number} id @returns {string} name of one of the eight colours of tracks in tokens.css, for charts and tables */
export function trackColour(id) {
  return `--track-${((id % 8) + 8) % 8}`;
}

/**
 * Rotate a vector from world axes into those of a body with the attitude `q` in the world.
 *
 * @param {number[]} q w, x, y, z
 * @param {number[]} v
 */
function rotateInverse(q, v) {
  const [w = 1, x = 0, y = 0, z = 0] = q;
  const [a = 0, b = 0, c = 0] = v;
  // v + 2 u x (u x v + w v) with u = -(x, y, z)
  const t = [2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)];
  const [tx = 0, ty = 0, tz = 0] = t;
  return [
    a + w * tx + (ty * z - tz * y),
    b + w * ty + (tz * x - tx * z),
    c + w * tz + (tx * y - ty * x),
  ];
}

/**
 * Make a sentence of the server's words, which begin in lower case and mostly lack a full stop.
 *
 * Addresses, sources, paths and parameters keep their spelling.
 *
 * @param {string} text
 */
export function sentence(text) {
  const words = text.trimEnd();
  const typed = /^(\S*[:_=.@]\S|(camera|coppeliasim|run|simulated|vicon-udp|video|vrpn):)/;
  const begin = typed.test(words) ? words.charAt(0) : words.charAt(0).toUpperCase();
  return `${begin}${words.slice(1)}${/[.!?]$/.test(words) ? "" : "."}`;
}

/** @param {number} seconds @returns {string} as in "1 min 5 s" */
export function durationInWords(seconds) {
  const whole = Math.round(seconds);
  return whole < 60 ? `${whole} s` : `${Math.floor(whole / 60)} min ${whole % 60} s`;
}
