"""Layers and views of the 3D scene, for the page's legend and camera."""

from __future__ import annotations

from fastapi import APIRouter

from app.contract.scene import SCENE, SceneFacts

router = APIRouter(tags=["views"])


@router.get("/scene", summary="Layers, colours and views of the 3D scene")
async def get_scene() -> SceneFacts:
    """Always the same; each browser decides by itself which layers it hides."""
    return SCENE
