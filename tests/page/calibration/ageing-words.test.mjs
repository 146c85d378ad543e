import assert from "node:assert/strict";
import { test } from "node:test";

import * as words from "../../../static/app/calibration/ageing-words.js";
import { ageing } from "../made.mjs";

const drifted = /** @type {const} */ ({
  status: "drifted",
  vergence_rad: 0.0014,
  std_rad: 0.0001,
  sentence: "the cameras converge more than calibrated",
  distance_m: 0,
});

test("refining names the vergence as kept, or as corrected once it drifted", () => {
  assert.match(
    words.refinementInWords(ageing()),
    /Vergence, baseline and lens parameters stay the same\.$/,
  );
  const offer = words.refinementInWords(ageing({ vergence: drifted }));
  assert.match(offer, /corrects the pitch, roll and vergence/);
  assert.match(offer, /calibration\. Baseline and lens parameters stay the same\.$/);
});

test("rows and vergence warn, each as a sentence, and nothing warns while all is well", () => {
  assert.equal(words.warningInWords(ageing()), "");
  assert.equal(
    words.warningInWords(ageing({ vergence: drifted })),
    "The cameras converge more than calibrated.",
  );
  const rows = { ...ageing().rows, warning: "rows are 0.8 px apart" };
  assert.equal(
    words.warningInWords(ageing({ rows, vergence: drifted })),
    "Rows are 0.8 px apart. The cameras converge more than calibrated.",
  );
});

test("a skew is told only where one is known", () => {
  assert.equal(words.skewInWords(ageing()), "");
  const exposure_skew = {
    exposure_skew_s: 0.0162,
    sigma_s: 0.0004,
    sentence: "the right camera exposes 16.2 +-0.4 ms after the left one",
  };
  assert.equal(
    words.skewInWords(ageing({ exposure_skew })),
    "The right camera exposes 16.2 +-0.4 ms after the left one.",
  );
});
