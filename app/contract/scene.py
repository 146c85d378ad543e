"""Layers and views of the 3D scene: the nodes that hold them, their colours, and their names.

All viewers share one scene; which layers are hidden, and from where it is seen, is up to each
browser.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.values import means
from observer.obstacle_colors import OBSTACLE_RGB, Rgb

Vector = tuple[float, float, float]
LayerName = Literal["cloud", "boxes", "arrows", "trails", "guard", "path", "map", "truth"]

# Level axes, z up, x ahead at the start; moved by whole steps to keep the robot in view.
DISPLAY_NODE = "/display"
WORLD_NODE = f"{DISPLAY_NODE}/world"
CAMERA_NODE = f"{WORLD_NODE}/camera"
BASE_NODE = f"{WORLD_NODE}/base"


@dataclass(frozen=True)
class SceneLayer:
    """Part of the scene that can be hidden."""

    name: LayerName
    title: str
    help: str
    node: Annotated[
        str, means("Parent of all nodes of the layer; the server itself never hides it.")
    ]
    colors: Annotated[Sequence[Rgb], means("RGB; empty: those of the camera image.")]


@dataclass(frozen=True)
class SceneView:
    """Viewpoint and target: metres ahead, left and up from the ground below the camera."""

    eye: Vector
    look_at: Vector


@dataclass(frozen=True)
class SceneFacts:
    layers: Sequence[SceneLayer]
    display_node: Annotated[str, means("Level axes: ahead at the start, left, up.")]
    camera_node: Annotated[str, means("Left camera: x right, y down, z forward.")]
    base_node: Annotated[
        str,
        means("The observer on the ground: ahead, left, up; hidden while its position is unknown."),
    ]
    follow: Annotated[SceneView, means("Along the robot's heading.")]
    top_down: Annotated[
        SceneView, means("Along the initial heading, whatever the robot's heading is.")
    ]


_LAYERS = (
    SceneLayer(
        "cloud", "Point cloud", "What dense stereo measures, in the colours of the image; "
        "obstacles are tinted like their boxes.", f"{WORLD_NODE}/cloud", (),
    ),
    SceneLayer(
        "boxes", "Boxes", "Obstacles, each with its speed and 95 % interval: moving (red), moving "
        "in place (orange), stopped (blue), out of view (grey).", f"{WORLD_NODE}/boxes",
        tuple(OBSTACLE_RGB.values()),
    ),
    SceneLayer(
        "arrows", "Arrows", "Velocity: the arrow ends where the obstacle will be in one second.",
        f"{WORLD_NODE}/arrows", ((255, 160, 20),),
    ),
    SceneLayer(
        "trails", "Trails", "Where the camera (blue) and the obstacles (rose) have been.",
        f"{WORLD_NODE}/trails", ((66, 133, 244), (214, 122, 122)),
    ),
    SceneLayer(
        "guard", "Guard zones", "Where an obstacle stops the robot (red) or slows it (orange), and "
        "sonar echoes (teal).", f"{WORLD_NODE}/guard",
        ((226, 44, 44), (255, 160, 20), (36, 160, 148)),
    ),
    SceneLayer(
        "path", "Path", "The goal of the observer and its planned path (violet), rejected paths "
        "(pale), and where it would meet the deciding obstacle (magenta ring).",
        f"{WORLD_NODE}/path", ((150, 70, 220), (158, 138, 190), (220, 50, 140)),
    ),
    SceneLayer(
        "map", "Local map", "What the observer knows about the room on its way to a goal: "
        "obstructions (brown) and floor recently seen to be free (green). The rest is unknown.",
        f"{WORLD_NODE}/map", ((158, 106, 54), (64, 168, 98)),
    ),
    SceneLayer(
        "truth", "Ground truth", "Ground-truth boxes, where available.", f"{WORLD_NODE}/truth",
        ((112, 150, 150),),
    ),
)  # fmt: skip
LAYERS: Mapping[LayerName, SceneLayer] = {layer.name: layer for layer in _LAYERS}

SCENE = SceneFacts(
    layers=_LAYERS,
    display_node=DISPLAY_NODE,
    camera_node=CAMERA_NODE,
    base_node=BASE_NODE,
    # Behind the robot, above it and somewhat to its left: the whole robot above the legend.
    follow=SceneView(eye=(-2.3, 1.1, 1.7), look_at=(2.0, -0.1, 0.1)),
    # A little behind what it looks at: from exactly above, up in the picture would be undefined.
    top_down=SceneView(eye=(1.19, 0.0, 9.0), look_at=(1.2, 0.0, 0.0)),
)
