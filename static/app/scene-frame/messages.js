/**
 * Messages between the page and the 3D scene in its frame. The frame has its own origin and
 * process, so that the page, including the stop button, never waits for a drawing.
 */

/** @import { SceneFacts } from "../contract" */
/** @import { FloorPlace } from "../shell/floor-pick.js" */
/** @import { CameraChoice } from "../live/scene-choice.js" */

/**
 * @typedef {object} Choice what to show and from where
 * @property {"choice"} kind
 * @property {SceneFacts} facts
 * @property {string[]} hidden nodes
 * @property {CameraChoice} camera
 */

/**
 * @typedef {Choice | {kind: "reset"} | {kind: "back"} | {kind: "ground", colour: string} |
 *   {kind: "pick", base: string | null}} ToFrame
 *   `reset`: look at the robot again; `back`: the page has its server back; `ground`: background
 *   colour; `pick`: wait for clicks on the floor, relative to the robot's node; null: stop waiting
 */

/**
 * @typedef {{kind: "ready", draws: boolean} | {kind: "drawn"} | {kind: "taken"} |
 *   {kind: "key", key: string, code: string} |
 *   {kind: "picked", place: FloorPlace | null, known: boolean}} FromFrame
 *   `ready`: it accepts choices (`draws`: this browser can draw it); `drawn`: the scene is on the
 *   screen; `taken`: the user moved the camera; `key`: Space or Esc, which apply to the whole page;
 *   `picked`: a requested click (`place`: null if not on the floor; `known`: whether the robot's
 *   position is)
 */

export {};
