/**
 * The page's start: one hub, and every part attached to it.
 *
 * What the live page shows at first is imported here, and all that stops robots. Everything else is
 * loaded after the first painted frame: each module that comes before it delays it.
 */

import "./driving/stop-bar.js";
import "./live/live-views.js";
import "./live/obstacle-table.js";
import "./live/scene.js";
import "./parameters/method-switch.js";
import "./runs/back-to-source.js";
import "./runs/run-bar.js";
import "./shell/first-line.js";
import "./shell/keyboard-help.js";
import "./shell/log-panel.js";
import "./shell/places.js";
import "./shell/share-link.js";
import "./shell/side-tabs.js";
import "./shell/sign-out.js";
import "./shell/splitter.js";
import "./shell/theme-choice.js";
import "./shell/tour.js";
import "./shell/watching.js";
import "./sources/playback-bar.js";
import { Driver } from "./driving/driver.js";
import { Part } from "./elements/part.js";
import { placeOf } from "./runs/run-words.js";
import { Hub } from "./shell/hub.js";
import { Later } from "./shell/later.js";

const HISTORY = "observer-history";
const WIZARD = "observer-calibration-wizard";

const hub = new Hub((hub) => new Driver(hub));
const later = new Later(hub, {
  "observer-speed-chart": () => import("./chart/speed-chart.js"),
  "observer-parameters": () => import("./parameters/parameter-form.js"),
  // The most modules of all, one press away.
  [HISTORY]: () => import("./history/history-view.js"),
  "observer-source-picker": () => import("./sources/source-picker.js"),
  "observer-live-truth": () => import("./sources/live-truth.js"),
  "observer-robots": () => import("./driving/robots-panel.js"),
  "observer-guard-check": () => import("./driving/guard-check.js"),
  "observer-goal": () => import("./driving/goal-panel.js"),
  "observer-programmes": () => import("./driving/programmes.js"),
  "observer-calibration": () => import("./calibration/calibration-panel.js"),
  "observer-calibration-health": () => import("./calibration/calibration-health.js"),
  "observer-rig": () => import("./calibration/rig-panel.js"),
  "observer-runs": () => import("./runs/run-list.js"),
  "observer-live-cameras": () => import("./live/live-cameras.js"),
  "observer-status": () => import("./live/status-panel.js"),
  "observer-ego-motion": () => import("./live/ego-motion.js"),
  [WIZARD]: () => import("./calibration/wizard.js"),
});
for (const element of document.querySelectorAll("[data-part]")) {
  if (element instanceof Part) element.attach(hub);
}
hub.addEventListener("status", () => {
  // Here or by another page, or because the server was started for it.
  if (hub.status?.calibrating || hub.status?.to_calibrate) void later.load(WIZARD);
});
hub.addEventListener("calibrate", () => {
  // It did not hear it.
  if (!later.has(WIZARD)) void later.load(WIZARD).then((there) => there && hub.tell("calibrate"));
});
window.addEventListener("hashchange", () => isAway() && void later.load(HISTORY));
hub.start();
// Whoever opens the page there is not shown the live parts first.
if (isAway()) await later.load(HISTORY);
document.body.removeAttribute("data-starting");

/** Say whether the address names what takes the place of the live parts. */
function isAway() {
  return placeOf(location.hash).view !== "none";
}
