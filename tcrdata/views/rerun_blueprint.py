"""How a recording's entities are laid out in the viewer."""

from __future__ import annotations

import rerun.blueprint as rrb

from tcrdata.views.palette import BACKGROUND, rgb

FRAME_TIMELINE = "frame"
_PLAYED_FPS = 10
_EYE_M = (0.0, -14.0, -18.0)
_LOOK_AT_M = (0.0, 1.0, 14.0)


def viewer_blueprint(metric_scale: float) -> rrb.Blueprint:
    """Return the scene beside the image, the plots below; the eye rides along behind the sensor."""
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=[metric_scale * value for value in _EYE_M],
        look_target=[metric_scale * value for value in _LOOK_AT_M],
        eye_up=[0.0, -1.0, 0.0],
    )
    scene = rrb.Spatial3DView(
        origin="world/level",
        contents="world/**",
        name="scene",
        background=rgb(BACKGROUND),
        eye_controls=eye,
    )
    picture = rrb.Spatial2DView(
        origin="world/level/camera",
        contents=["$origin/**", "world/level/boxes/labels", "world/level/boxes/truth"],
        name="image",
    )
    plots = rrb.Tabs(
        *(
            rrb.TimeSeriesView(origin=f"plots/{name}", name=title)
            for name, title in (("score", "scores"), ("points", "points"), ("count", "boxes"))
        )
    )
    return rrb.Blueprint(
        rrb.Horizontal(scene, rrb.Vertical(picture, plots), column_shares=[3, 2]),
        rrb.TimePanel(timeline=FRAME_TIMELINE, fps=_PLAYED_FPS),
        collapse_panels=True,
    )
