/** The page's start: one hub, and every part attached to it. */

import "./calibration/calibration-health.js";
import "./calibration/calibration-panel.js";
import "./calibration/rig-panel.js";
import "./calibration/wizard.js";
import "./chart/speed-chart.js";
import "./driving/guard-check.js";
import "./driving/programmes.js";
import "./driving/robots-panel.js";
import "./driving/stop-bar.js";
import "./history/history-view.js";
import "./live/ego-motion.js";
import "./live/live-cameras.js";
import "./live/live-views.js";
import "./live/obstacle-table.js";
import "./live/scene.js";
import "./live/status-panel.js";
import "./parameters/method-switch.js";
import "./parameters/parameter-form.js";
import "./runs/run-bar.js";
import "./runs/run-list.js";
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
import "./sources/live-truth.js";
import "./sources/playback-bar.js";
import "./sources/source-picker.js";
import { Driver } from "./driving/driver.js";
import { Part } from "./elements/part.js";
import { Hub } from "./shell/hub.js";

const hub = new Hub((hub) => new Driver(hub));
for (const element of document.querySelectorAll("[data-part]")) {
  if (element instanceof Part) element.attach(hub);
}
document.body.removeAttribute("data-starting");
hub.start();
