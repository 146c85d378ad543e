/**
 * Entry point of the page: one hub, with every part attached to it.
 *
 * Only what the live page shows at first and everything that stops robots is imported here. The
 * rest is loaded after the first painted frame, since every module before it delays that frame.
 */

import "./driving/stop-bar.js";
import "./live/live-views.js";
import "./live/obstacle-table.js";
import "./live/scene.js";
import "./parameters/method-switch.js";
import "./runs/back-to-source.js";
import "./runs/run-bar.js";
import "./shell/headline.js";
import "./shell/keyboard-help.js";
import "./shell/log-panel.js";
import "./shell/page-nav.js";
import "./shell/share-link.js";
import "./shell/side-tabs.js";
import "./shell/sign-out.js";
import "./shell/splitter.js";
import "./shell/theme-choice.js";
import "./shell/tour.js";
import "./shell/read-only.js";
import "./sources/playback-bar.js";
import { Driver } from "./driving/driver.js";
import { Part } from "./elements/part.js";
import { placeOf } from "./runs/run-words.js";
import { Hub } from "./shell/hub.js";
import { LazyParts } from "./shell/lazy-parts.js";

const PAGES = "observer-pages";
const WIZARD = "observer-calibration-wizard";

const hub = new Hub((hub) => new Driver(hub));
const lazyParts = new LazyParts(hub, {
  "observer-speed-chart": () => import("./chart/speed-chart.js"),
  "observer-parameters": () => import("./parameters/parameter-form.js"),
  // It has the most modules and is one click away.
  [PAGES]: () => import("./pages/pages-view.js"),
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
  // Started here, by another page, or because the server was started to calibrate.
  if (hub.status?.calibrating || hub.status?.to_calibrate) void lazyParts.load(WIZARD);
});
hub.addEventListener("calibrate", () => {
  // The wizard was not loaded yet and missed the event.
  if (!lazyParts.has(WIZARD))
    void lazyParts.load(WIZARD).then((there) => there && hub.emit("calibrate"));
});
window.addEventListener("hashchange", () => isAway() && void lazyParts.load(PAGES));
hub.start();
// Do not show the live parts first if the page is opened at another view.
if (isAway()) await lazyParts.load(PAGES);
document.body.removeAttribute("data-starting");

/** Return whether the address names a view that replaces the live parts. */
function isAway() {
  return placeOf(location.hash).view !== "none";
}
