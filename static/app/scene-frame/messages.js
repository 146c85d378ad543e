/**
 * What the page and the 3D scene in its frame tell each other. The frame has an origin and a process
 * of its own, so that the page, and what stops the robots, never waits for a drawing.
 */

/** @import { SceneFacts } from "../contract" */
/** @import { FloorPlace } from "../shell/floor-pick.js" */
/** @import { CameraChoice } from "../live/scene-choice.js" */

/**
 * @typedef {object} Choice what to show, from where
 * @property {"choice"} kind
 * @property {SceneFacts} facts
 * @property {string[]} hidden nodes
 * @property {CameraChoice} camera
 */

/**
 * @typedef {Choice | {kind: "reset"} | {kind: "back"} | {kind: "ground", colour: string} |
 *   {kind: "pick", base: string | null}} ToFrame
 *   `reset`: look at the robot again; `back`: the page has its server back; `ground`: colour where
 *   nothing is drawn; `pick`: wait for clicks on the floor, as seen from the robot's node; null: no
 *   more
 */

/**
 * @typedef {{kind: "ready", draws: boolean} | {kind: "drawn"} | {kind: "taken"} |
 *   {kind: "key", key: string, code: string} |
 *   {kind: "picked", place: FloorPlace | null, known: boolean}} FromFrame
 *   `ready`: it can be told what to show (`draws`: this browser has what it draws with); `drawn`: the
 *   scene is on the screen; `taken`: a hand moved the camera; `key`: Space or Esc, which mean something
 *   on the whole page; `picked`: a click that was waited for (`place`: null where no floor is; `known`:
 *   whether the robot's place is)
 */

export {};
