"""The words of the page, the reports and the documentation: one meaning each, declared once.

The documentation's glossary is generated from it (``tools.docs``), and so are the page's tooltips
(``tools/packaging/frontend.py types``). A test searches everything that a person can read for the
wordings to be avoided.
"""

from __future__ import annotations

from dataclasses import dataclass

from observer.intervals import SIGMAS_95


@dataclass(frozen=True)
class Term:
    """One word and its meaning.

    Attributes:
        name: as it is shown within a sentence.
        meaning: one or two self-contained sentences, without markup.
        page: of the documentation, with more about it; empty for none.
        avoided: regular expressions for wordings not to be used in its place.
    """

    name: str
    meaning: str
    page: str = ""
    avoided: tuple[str, ...] = ()


GLOSSARY: tuple[Term, ...] = (
    Term(
        "95 % interval",
        "Range that contains the true value in 95 of 100 cases if the stated uncertainty is "
        f"right. Every ± is half of it, which is {SIGMAS_95:g} standard deviations. Data files "
        "contain standard deviations.",
        avoided=(
            r"\bsigmas?\b(?!:)",
            r"\bband of 95",
            r"95 % band",
            r"(?<!\w)\+-(?!\w)",
            r"(?<!\w)\+/-(?!\w)",
            r"standard deviations? from standing",
        ),
    ),
    Term(
        "alignment",
        "Finding the time offset between the clocks of motion capture and of the run, the pose "
        "of the room in the run's world frame, and which track is which body.",
        "motion-capture.md",
    ),
    Term(
        "armed",
        "The motors of a robot are on and it follows commands. After a stop, robots stay disarmed "
        "until an operator arms them again.",
        "safety.md",
    ),
    Term("base", "Coordinate frame of the robot: x forward, y left, z up."),
    Term("baseline", "Distance between the two cameras."),
    Term(
        "calibration health",
        "How well the calibration in use still fits the images: epipolar error, vergence and "
        "sync error, measured while the cameras run.",
        "calibration.md",
        avoided=(r"\bhow it holds\b",),
    ),
    Term(
        "camera frame", "Coordinate frame of the rectified left camera: x right, y down, z forward."
    ),
    Term(
        "coasting",
        "State of a confirmed obstacle that is out of sight for a moment: its position is "
        "predicted, its speed is not measured.",
    ),
    Term(
        "control",
        "The right to drive a robot. One operator has it at a time; others can take it over, and "
        "it ends when the page is closed.",
        "safety.md",
        avoided=(r"\bgive (it )?back\b", r"\bgave the lease\b", r"\bthis lease\b"),
    ),
    Term(
        "coverage",
        "Share of the errors that lie within the stated 95 % interval. About 95 % means that the "
        "uncertainty is neither too small nor too large.",
    ),
    Term(
        "degraded",
        "Status of a frame that was processed, but in which an obstacle may have been missed. "
        "The reasons say why.",
    ),
    Term(
        "disparity",
        "Horizontal shift of a point between the left and the right image, in pixels. Depth is "
        "focal length times baseline over disparity.",
    ),
    Term(
        "dropped frames",
        "Frames of the source that were not processed because the computer was too slow.",
        avoided=(r"\b(frames|messages) left out\b", r"\b(lost|missed) frames\b"),
    ),
    Term(
        "ego-motion",
        "The camera's own motion between two frames.",
        avoided=(r"\bego ?motion\b",),
    ),
    Term(
        "epipolar error",
        "Vertical distance between a point in the right image and the row on which the "
        "calibration expects it, in pixels.",
        "calibration.md",
        avoided=(r"\brows? of left and right\b", r"\bvertical (error|offset)s?\b"),
    ),
    Term(
        "extrinsics",
        "Position and orientation of one camera relative to the other, or to the robot.",
    ),
    Term(
        "goal",
        "Place on the ground to which the observer drives autonomously, around obstacles, while "
        "its operator is present.",
        "goal.md",
    ),
    Term(
        "ground truth",
        "The true motion of a body, from the simulator or from motion capture.",
        "motion-capture.md",
        avoided=(
            r"(?<!ground )(?<!ground-)(?<!ground‑)\btruths?\b(?!\.csv|/|-| or matched_)",
            r"\blay (ground )?truth over\b",
        ),
    ),
    Term(
        "guard",
        "Part of the drive process that slows and stops the robots according to what the "
        "cameras and the sonar see. It is not a certified safety function.",
        "guard.md",
    ),
    Term(
        "identity switch",
        "A body's track ends and the body continues under a different track ID.",
        avoided=(r"\bchanges? of identity\b", r"\bID[ -]?switch"),
    ),
    Term(
        "in place",
        "State of an obstacle that moves without going anywhere, such as a person waving both "
        "arms.",
    ),
    Term("inlier", "Match that agrees with the estimated ego-motion."),
    Term(
        "keypoint",
        "Place in the image that can be found again in the next one; also called feature.",
    ),
    Term("latency", "Time from an exposure until its result is available."),
    Term(
        "local map",
        "Grid of 0.1 m cells around the observer on its way to a goal. A cell is free or blocked "
        "if it was recently seen to be; all others are unknown.",
        "goal.md",
    ),
    Term(
        "lost",
        "Status of a frame whose ego-motion could not be estimated. Nothing can be said about "
        "motion in it.",
    ),
    Term("monocular", "Using the left camera only.", "one-camera.md"),
    Term("observer", "The robot that carries the cameras; also the name of the library."),
    Term(
        "obstacle",
        "Something that moves or has moved, tracked with position, velocity, box and uncertainty. "
        "Also the role of the second robot, which is there to be detected.",
    ),
    Term(
        "planar method",
        "A method that maps image to image, affine or homography. The paper uses affine.",
    ),
    Term("preset", "Named set of parameters: default, paper, or your own.", "presets.md"),
    Term(
        "programme",
        "Timed sequence of velocities for robots; called motion profile in the code.",
        "your-robot.md",
    ),
    Term(
        "re-run",
        "A new run that processes the recorded images of an earlier run again, with other "
        "parameters or another calibration.",
        "runs.md",
        avoided=(r"\bobserved? (once more|again|anew)\b", r"\bobserve again\b"),
    ),
    Term("recording", "The MCAP file of a run.", "runs.md"),
    Term(
        "reprojection error",
        "Distance between where a point is seen and where the estimate puts it, in pixels.",
    ),
    Term("residual", "Motion of a point in the image that ego-motion does not explain, in pixels."),
    Term("rig", "How the camera is mounted on its robot, and which robots there are: rig.yaml."),
    Term("run", "One recorded observation with all its settings.", "runs.md"),
    Term("scenario", "A simulated world and the motions in it.", "sources.md"),
    Term(
        "segment",
        "Part of a run with one world frame. A new one starts when the ego-motion was lost for "
        "too long, the method changed or the engine was replaced.",
    ),
    Term(
        "significance",
        "How far a motion exceeds its uncertainty, in standard deviations (σ) above zero.",
        avoided=(r"\bstands? out (by|together)\b", r"standard deviations (more|only)\b"),
    ),
    Term(
        "software stop",
        "Stops and disarms all robots through this software. It is not a substitute for an "
        "emergency stop: keep the robots' own switch within reach.",
        "safety.md",
        avoided=(r"\bno emergency stop\b", r"\be-?stop\b"),
    ),
    Term(
        "source",
        "Where frames come from: cameras, files, a recording or a simulator.",
        "sources.md",
    ),
    Term(
        "sync error",
        "Time between the exposures of the left and the right image.",
        avoided=(r"\bskew noise\b", r"\btime skew\b"),
    ),
    Term("tentative", "State of a track that is not confirmed yet."),
    Term("track", "One obstacle followed over time under one ID."),
    Term(
        "unmatched",
        "A track that matches no body of the ground truth.",
        avoided=(r"\bof no known body\b",),
    ),
    Term(
        "vergence",
        "Angle between the viewing directions of the two cameras, in the plane of the baseline.",
    ),
    Term(
        "world frame",
        "The camera frame at the first valid pose of a segment. Obstacles are given in it, so "
        "that a parked one has velocity 0.",
    ),
)
