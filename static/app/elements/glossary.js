/** Words and their meaning, for tooltips: made from app/contract/glossary.py. */

export const GLOSSARY = {
  "95 % interval":
    "Range that contains the true value in 95 of 100 cases if the stated uncertainty is right. Every ± is half of it, which is 1.96 standard deviations. Data files contain standard deviations.",
  "alignment":
    "Finding the time offset between the clocks of motion capture and of the run, the pose of the room in the run's world frame, and which track is which body.",
  "armed":
    "The motors of a robot are on and it follows commands. After a stop, robots stay disarmed until an operator arms them again.",
  "base": "Coordinate frame of the robot: x forward, y left, z up.",
  "baseline": "Distance between the two cameras.",
  "calibration health":
    "How well the calibration in use still fits the images: epipolar error, vergence and sync error, measured while the cameras run.",
  "camera frame": "Coordinate frame of the rectified left camera: x right, y down, z forward.",
  "coasting":
    "State of a confirmed obstacle that is out of sight for a moment: its position is predicted, its speed is not measured.",
  "control":
    "The right to drive a robot. One operator has it at a time; others can take it over, and it ends when the page is closed.",
  "coverage":
    "Share of the errors that lie within the stated 95 % interval. About 95 % means that the uncertainty is neither too small nor too large.",
  "degraded":
    "Status of a frame that was processed, but in which an obstacle may have been missed. The reasons say why.",
  "disparity":
    "Horizontal shift of a point between the left and the right image, in pixels. Depth is focal length times baseline over disparity.",
  "dropped frames":
    "Frames of the source that were not processed because the computer was too slow.",
  "ego-motion": "The camera's own motion between two frames.",
  "epipolar error":
    "Vertical distance between a point in the right image and the row on which the calibration expects it, in pixels.",
  "extrinsics": "Position and orientation of one camera relative to the other, or to the robot.",
  "goal":
    "Place on the ground to which the observer drives autonomously, around obstacles, while its operator is present.",
  "ground truth": "The true motion of a body, from the simulator or from motion capture.",
  "guard":
    "Part of the drive process that slows and stops the robots according to what the cameras and the sonar see. It is not a certified safety function.",
  "identity switch": "A body's track ends and the body continues under a different track ID.",
  "in place":
    "State of an obstacle that moves without going anywhere, such as a person waving both arms.",
  "inlier": "Match that agrees with the estimated ego-motion.",
  "keypoint": "Place in the image that can be found again in the next one; also called feature.",
  "latency": "Time from an exposure until its result is available.",
  "local map":
    "Grid of 0.1 m cells around the observer on its way to a goal. A cell is free or blocked if it was recently seen to be; all others are unknown.",
  "lost":
    "Status of a frame whose ego-motion could not be estimated. Nothing can be said about motion in it.",
  "monocular": "Using the left camera only.",
  "observer": "The robot that carries the cameras; also the name of the library.",
  "obstacle":
    "Something that moves or has moved, tracked with position, velocity, box and uncertainty. Also the role of the second robot, which is there to be detected.",
  "planar method":
    "A method that maps image to image, affine or homography. The paper uses affine.",
  "preset": "Named set of parameters: default, paper, or your own.",
  "programme": "Timed sequence of velocities for robots; called motion profile in the code.",
  "re-run":
    "A new run that processes the recorded images of an earlier run again, with other parameters or another calibration.",
  "recording": "The MCAP file of a run.",
  "reprojection error":
    "Distance between where a point is seen and where the estimate puts it, in pixels.",
  "residual": "Motion of a point in the image that ego-motion does not explain, in pixels.",
  "rig": "How the camera is mounted on its robot, and which robots there are: rig.yaml.",
  "run": "One recorded observation with all its settings.",
  "scenario": "A simulated world and the motions in it.",
  "segment":
    "Part of a run with one world frame. A new one starts when the ego-motion was lost for too long, the method changed or the engine was replaced.",
  "significance":
    "How far a motion exceeds its uncertainty, in standard deviations (σ) above zero.",
  "software stop":
    "Stops and disarms all robots through this software. It is not a substitute for an emergency stop: keep the robots' own switch within reach.",
  "source": "Where frames come from: cameras, files, a recording or a simulator.",
  "sync error": "Time between the exposures of the left and the right image.",
  "tentative": "State of a track that is not confirmed yet.",
  "track": "One obstacle followed over time under one ID.",
  "unmatched": "A track that matches no body of the ground truth.",
  "vergence":
    "Angle between the viewing directions of the two cameras, in the plane of the baseline.",
  "world frame":
    "The camera frame at the first valid pose of a segment. Obstacles are given in it, so that a parked one has velocity 0.",
};
