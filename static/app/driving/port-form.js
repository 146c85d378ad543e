/** Port and model of a role's robot. */

import { button, field, fillList, h, input, onSubmit, select, setText } from "../elements/dom.js";
import { ROBOT_MODELS } from "../elements/facts.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { attemptIn, notify, exclusiveRunner, showError } from "../shell/notice.js";

/** @import { Devices, RobotsMessage, SerialPortNow } from "../contract" */
/** @import { Role } from "./roles.js" */

const MODELS = [["", "As reported by the robot"], ...Object.entries(ROBOT_MODELS)];
const EXAMPLE_ADDRESSES = [
  ["socket://localhost:8101", "a robot on the network, or the manufacturer's simulator"],
  ["external:127.0.0.1:7700", "a custom robot on this server"],
  ["coppeliasim:localhost:23000/PioneerP3DX", "a robot in a CoppeliaSim scene"],
];

export class PortForm extends Part {
  #port = input("text", "robot-port", {
    list: "robot-ports",
    spellcheck: "false",
    required: true,
    "aria-describedby": "robot-port-error",
  });
  #ports = h("datalist", { id: "robot-ports" });
  #found = h("p.hint", { role: "status" });
  #troubles = h("ul.plain-list.warnings");
  #again = button("Find ports", () => this.#look());
  #model = select({ id: "robot-model" }, MODELS);
  #error = h("p.field-error", { role: "alert", id: "robot-port-error" });
  #connect = h("button.button.primary", { type: "submit" }, "Connect");
  #forget = button("Remove port", () => this.#do(() => this.#drop()));
  #own = h("p.hint");
  /** @type {Role} */
  #role = "observer";
  #shown = "";
  /** True while the form holds values that are not in use yet. */
  #changed = false;
  #do = exclusiveRunner(undefined, this.#error);

  build() {
    const form = h(
      "form.stack",
      { novalidate: true },
      field(
        "Port",
        this.#port,
        "A serial port on the server, socket://HOST:8101, coppeliasim:HOST:PORT/OBJECT, or external:HOST:PORT?key=KEY for a custom robot. A saved key is hidden; leave this field unchanged to keep it.",
      ),
      this.#ports,
      this.#found,
      this.#troubles,
      field("Model", this.#model),
      this.#error,
      h("div.row", this.#connect, this.#forget, this.#again),
      this.#own,
    );
    this.append(form);
    onSubmit(form, () => this.#save());
    form.addEventListener("input", () => {
      this.#changed = true;
    });
    this.listen("reconnected", () => this.#look());
    this.listen("change", () => this.#render(), this.hub.driver);
    this.listen("robots", () => this.#render());
    this.#render();
    void this.#look();
  }

  /** Suggest the serial ports that exist now. */
  async #look() {
    /** @type {Devices | null} */
    const devices = await request("GET", "/devices").catch(() => null);
    const ports = devices?.serial_ports ?? [];
    this.#ports.replaceChildren(
      ...ports.map((port) => h("option", { value: port.by_id ?? port.path }, wordsOf(port))),
      ...EXAMPLE_ADDRESSES.map(([value, words]) => h("option", { value }, words ?? "")),
    );
    setText(
      this.#found,
      !devices
        ? "The server did not report its serial ports."
        : ports.length === 0
          ? "The server has no USB serial port."
          : `On the server: ${ports.map(wordsOf).join("; ")}.`,
    );
    fillList(
      this.#troubles,
      ports.flatMap(({ trouble }) => trouble ?? []),
    );
  }

  #render() {
    const { driver, robots } = this.hub;
    const kept = robots?.ports?.[driver.role] ?? null;
    const robot = driver.robot();
    const key = `${driver.role} ${kept?.port} ${kept?.model} ${robot?.port}`;
    this.#forget.disabled = !kept;
    if (key === this.#shown) return;
    if (this.#role !== driver.role) this.#changed = false;
    this.#shown = key;
    this.#role = driver.role;
    setText(
      this.#own,
      robot && robot.port !== kept?.port
        ? `The ${driver.role} at ${robot.port} is provided by the current source.`
        : "",
    );
    // Do not overwrite what was typed meanwhile.
    if (this.#changed) return;
    showError(this.#error, "");
    this.#port.value = kept?.port ?? "";
    this.#model.value = kept?.model ?? "";
  }

  async #save() {
    const role = this.#role;
    const port = this.#port.value.trim();
    if (!port) return showError(this.#error, "Enter the robot's port.");
    await attemptIn(this.#error, async () => {
      /** @type {RobotsMessage} */
      const robots = await request("PUT", `/robots/${role}/port`, {
        port,
        model: this.#model.value || null,
      });
      // Show the port as the server returns it: a typed key is stored but no longer shown.
      const shown = robots.ports?.[role]?.port ?? "";
      if (this.#role === role && this.#port.value.trim() === port) {
        this.#port.value = shown;
        this.#changed = false;
      }
      notify(
        robots.world === "real"
          ? `Connecting the ${role} at ${shown}.`
          : `Saved ${shown} for the ${role}. It connects when live cameras are open.`,
      );
    });
  }

  async #drop() {
    const role = this.#role;
    this.#changed = false;
    await request("DELETE", `/robots/${role}/port`);
    notify(`Removed the ${role}'s port.`);
  }
}

/** @param {SerialPortNow} port */
function wordsOf({ path, description, usable }) {
  return `${path}${description ? ` (${description})` : ""}${usable ? "" : ", access denied"}`;
}

customElements.define("observer-robot-port", PortForm);
