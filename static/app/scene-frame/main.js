/** Runs in the viewer's page: shows what the outer page chooses and reports user input to it. */

import { listenForClicks, onFloor } from "./floor-click.js";
import { SceneCamera, onUserMove } from "./scene-camera.js";
import { SceneClient } from "./scene-client.js";

/** @import { Choice, FromFrame, ToFrame } from "./messages.js" */

// The viewer's own settings panel (a window, or a drawer on narrow screens) and its notices; the
// page has its own. viser has no setting to hide them.
const HIDE_PANEL =
  "#root .mantine-Paper-root, .mantine-Notifications-root { display: none !important }";
const PICK_CURSOR = "[data-pick] canvas { cursor: crosshair !important }";
// The viewer's background, which follows the page's colours.
const GROUND =
  '#root div[style*="background-color"]:has(canvas) { background-color: COLOUR !important }';

const client = new SceneClient(window);
const style = document.head.appendChild(document.createElement("style"));
/** @type {Choice | null} */
let choice = null;
/** @type {SceneCamera | null} */
let camera = null;
/** Drawings since the scene arrived; the first may have been without it. */
let drawings = 0;
/** The robot's node while waiting for a click on the floor. @type {string | null} */
let base = null;

/** @param {Choice} wanted */
function choose(wanted) {
  choice = wanted;
  camera ??= new SceneCamera(client, wanted.facts);
  const moved = camera.choice !== wanted.camera;
  camera.choice = wanted.camera;
  if (moved && wanted.camera !== "free") camera.reset();
  follow();
}

function drawn() {
  const layers = choice?.facts.layers ?? [];
  const arrived = layers.some(({ node }) => client.shows(node) !== null);
  if (arrived && ++drawings === 2) post({ kind: "drawn" });
  follow();
}

/** Apply the choice to the viewer, which starts out, and restarts after a loss, showing all. */
function follow() {
  for (const { node } of choice?.facts.layers ?? []) {
    const shown = client.shows(node);
    const hidden = choice?.hidden.includes(node) ?? false;
    if (shown === hidden) client.show(node, !hidden);
  }
  camera?.step(performance.now());
}

/** @param {string} colour */
function paint(colour) {
  style.textContent = `${HIDE_PANEL} ${PICK_CURSOR} ${GROUND.replace("COLOUR", colour)}`;
}

/** @param {string | null} node */
function pick(node) {
  base = node;
  document.documentElement.toggleAttribute("data-pick", node !== null);
}

/** @param {number} x @param {number} y px */
function clicked(x, y) {
  if (base === null) return;
  const robot = client.shows(base) ? client.frame(base) : null;
  const ray = client.ray(x, y);
  post({ kind: "picked", place: robot && ray && onFloor(ray, robot), known: robot !== null });
}

/** @param {FromFrame} message */
function post(message) {
  parent.postMessage(message, "*");
}

/** Return whether this browser has WebGL 2, which the viewer draws with. */
function canDraw() {
  const context = document.createElement("canvas").getContext("webgl2");
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return context !== null;
}

addEventListener("message", ({ source, data }) => {
  if (source !== parent) return;
  const message = /** @type {ToFrame} */ (data);
  if (message.kind === "choice") choose(message);
  else if (message.kind === "reset") camera?.reset();
  else if (message.kind === "pick") pick(message.base);
  else if (message.kind === "ground") paint(message.colour);
});
addEventListener("keydown", ({ key, code, ctrlKey, metaKey, altKey, repeat }) => {
  const meant = (code === "Space" || key === "Escape") && !ctrlKey && !metaKey && !altKey;
  if (meant && !repeat) post({ kind: "key", key, code });
});
onUserMove(window, () => post({ kind: "taken" }));
listenForClicks(window, clicked);
addEventListener("drawn", drawn);
post({ kind: "ready", draws: canDraw() });
