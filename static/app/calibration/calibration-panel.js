/** Calibrations: upload one, look at the rectified pair, then use it. */

import {
  button,
  details,
  dropZone,
  field,
  h,
  iconButton,
  input,
  item,
  select,
  setText,
  stateChip,
} from "../elements/dom.js";
import { KeyedList, moveFocus } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { ApiError, request } from "../shell/api.js";
import { promptText, attempt, attemptIn, askConfirmation, notify } from "../shell/notice.js";
import { refusalInWords } from "./calibration-words.js";
import { compareCalibrations, describe, confirmPreview } from "./calibration-preview.js";

/** @import { Calibration } from "./report-parts.js" */
/** @import { Status } from "../contract" */

/** @type {[string, string][]} */
const CAMERAS = [
  ["", "Match the images"],
  ["grey", "KITTI's grey cameras"],
  ["colour", "KITTI's colour cameras"],
];

class CalibrationPanel extends Part {
  #file = input("file", "calibration-file", {
    multiple: true,
    accept: ".yaml,.yml,.xml,.json,.npz,.txt,.conf,.mat",
    "aria-describedby": "calibration-file-help calibration-error",
  });
  #size = input("text", "calibration-size", { placeholder: "for example 1280x720" });
  #unit = input("text", "calibration-unit", { placeholder: "for example mm", maxlength: 40 });
  #cameras = select({ id: "calibration-cameras" }, CAMERAS);
  #error = h("p.field-error", { id: "calibration-error", role: "alert" });
  #open = details(
    "Advanced",
    h(
      "div.stack",
      field("Image size, if the file has none", this.#size),
      field(
        "Unit",
        this.#unit,
        "Unit of length in the file: m, cm, mm or in. If the file counts in board squares, enter the side of a square, for example 25mm. Leave empty for the format's default.",
      ),
      field("Cameras", this.#cameras),
    ),
  );
  #list = h("ul.item-list");
  #items = new KeyedList(
    this.#list,
    (/** @type {Calibration} */ calibration) => this.#item(calibration),
    () => this.#make,
  );
  #make = button("Calibrate cameras", () => this.hub.emit("calibrate"), {
    class: "button primary",
  });
  #empty = h(
    "p.empty",
    { hidden: true },
    "No saved calibrations. The source's own calibration is in use.",
  );
  #compare = button("Compare", () => compareCalibrations(this.#all.slice(0, 4)), {
    hidden: true,
    "data-harmless": true,
  });
  #own = button("Use the source's own", () => this.#deactivate());
  /** @type {Calibration[]} */
  #all = [];
  #active = "";

  build() {
    const drop = dropZone(
      this.#file,
      "Choose a calibration file, or drop it here",
      "OpenCV, ROS, NumPy, Kalibr, KITTI, MATLAB, Middlebury, ZED, OAK or EuRoC; the format is detected automatically. If a calibration consists of two files, choose both at once. You see the rectified pair before you use the calibration.",
      (files) => this.#send(files),
      this.#open,
      this.#error,
    );
    this.append(
      h("h2", "Calibration"),
      h("p.hint", "Calibrating with a printed board takes about five minutes."),
      h("div.row", this.#make),
      h("h3", "Import a calibration"),
      drop,
      h("h3", "Saved calibrations"),
      this.#empty,
      this.#list,
      h("div.row", this.#compare, this.#own),
    );
    this.listen("reconnected calibrations", () => this.#load());
    this.listen("status", () => {
      const active = this.hub.status?.calibration?.id ?? "";
      if (active === this.#active) return;
      this.#active = active;
      this.#renderList();
    });
    void this.#load();
  }

  async #load() {
    /** @type {Calibration[] | null} */
    const all = await request("GET", "/calibrations").catch(() => null);
    if (!all) return;
    this.#all = all;
    this.#empty.hidden = all.length > 0;
    this.#renderList();
  }

  #renderList() {
    this.#items.show(
      this.#all,
      ({ id }) => id,
      (calibration) => JSON.stringify([calibration, calibration.id === this.#active]),
    );
    for (const [button, unused] of /** @type {const} */ ([
      [this.#own, this.#active === ""],
      [this.#compare, this.#all.length < 2],
    ])) {
      if (unused) moveFocus(button, this.#list.querySelector("button"), this.#make);
      button.hidden = unused;
    }
  }

  /** @param {Calibration} calibration */
  #item(calibration) {
    const active = calibration.id === this.#active;
    const remove = iconButton(
      "trash",
      `Delete calibration ${calibration.name}`,
      () => this.#remove(calibration),
      { disabled: active, title: active ? "In use" : "Delete" },
    );
    const name = button("Rename", () => this.#rename(calibration), {
      "aria-label": `Rename calibration ${calibration.name}`,
    });
    const look = button("Preview", () => this.#look(calibration), {
      "aria-label": `Preview calibration ${calibration.name}`,
    });
    return item(
      [
        h("p", h("b", calibration.name), " ", active && stateChip("running", "in use")),
        h("p.hint", describe(calibration)),
      ],
      look,
      name,
      remove,
    );
  }

  /** @param {File[]} files */
  async #send(files) {
    if (files.length === 0) return;
    const form = new FormData();
    for (const file of files) form.append("file", file);
    for (const [name, { value }] of /** @type {const} */ ([
      ["size", this.#size],
      ["unit", this.#unit],
      ["cameras", this.#cameras],
    ])) {
      if (value.trim()) form.append(name, value.trim());
    }
    const taken = await attemptIn(this.#error, async () => {
      /** @type {Calibration} */
      const calibration = await request("POST", "/calibrations", form).catch((error) => {
        // The field for the unit is collapsed at first.
        if (error instanceof ApiError && "unit" in error.fields) {
          this.#open.toggleAttribute("open", true);
          this.#unit.focus();
        }
        throw error;
      });
      this.hub.emit("calibrations");
      // Not awaited, so that files can be chosen again meanwhile.
      void this.#look(calibration);
    });
    if (taken) return;
    const names = files.map((file) => file.name);
    setText(this.#error, refusalInWords(names, this.#error.textContent ?? ""));
  }

  /** @param {Calibration} calibration */
  async #look(calibration) {
    const use = await confirmPreview(calibration, calibration.id === this.#active);
    if (!use) return;
    const path = `/calibrations/${encodeURIComponent(calibration.id)}/activate`;
    await this.#change(path, `${calibration.name} is now in use.`);
  }

  /** @param {Calibration} calibration */
  async #rename(calibration) {
    const name = await promptText(
      `Rename calibration ${calibration.name}`,
      "Name",
      calibration.name,
    );
    if (!name || name === calibration.name) return;
    await attempt(() =>
      request("PATCH", `/calibrations/${encodeURIComponent(calibration.id)}`, { name }),
    );
    this.hub.emit("calibrations");
  }

  async #deactivate() {
    await this.#change("/calibrations/deactivate", "The source's own calibration is now in use.");
  }

  /**
   * @param {string} path
   * @param {string} done
   */
  async #change(path, done) {
    await attempt(async () => {
      /** @type {Status} */
      const status = await request("POST", path);
      this.hub.applyStatus(status);
      notify(done);
      this.hub.emit("calibrations");
    });
  }

  /** @param {Calibration} calibration */
  async #remove(calibration) {
    const sure = await askConfirmation(
      `Delete calibration ${calibration.name}?`,
      "You cannot undo this. Runs that used it keep their results.",
      "Delete calibration",
    );
    if (!sure) return;
    await attempt(async () => {
      await request("DELETE", `/calibrations/${encodeURIComponent(calibration.id)}`);
      notify(`Calibration ${calibration.name} deleted.`);
    });
    this.hub.emit("calibrations");
  }
}

customElements.define("observer-calibration", CalibrationPanel);
