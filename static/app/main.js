/** The page's start: one hub, and every part attached to it. */

import "./calibrating/wizard.js";
import "./calibration-health.js";
import "./calibration-panel.js";
import "./driving/guard-check.js";
import "./driving/programmes.js";
import "./driving/robots-panel.js";
import "./driving/stop-bar.js";
import "./ego-motion.js";
import "./first-line.js";
import "./freshness-banner.js";
import "./live-cameras.js";
import "./live-truth.js";
import "./live-views.js";
import "./obstacle-table.js";
import "./parameter-form.js";
import "./playback-bar.js";
import "./rig-panel.js";
import "./run-bar.js";
import "./run-list.js";
import "./runs/history-view.js";
import "./scene.js";
import "./side-tabs.js";
import "./source-picker.js";
import "./speed-chart.js";
import "./status-panel.js";
import "./theme-choice.js";
import { Hub } from "./hub.js";
import { Part } from "./part.js";

const hub = new Hub();
for (const element of document.querySelectorAll("[data-part]")) {
  if (element instanceof Part) element.attach(hub);
}
hub.start();
