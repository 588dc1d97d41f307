"""What refinement reads and gives: its settings, the sightings of one object, the refined path."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tcrdata.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class RefinementSettings:
    """How a track is refined; metres are multiplied by the metric scale.

    The `vehicle_` proportions fill in a side that never came into view and decide nothing: what
    the points show stays in the columns `seen_length_m` and `seen_width_m`, for rules to compare.

    Attributes:
        passes: rounds of heading, size, anchors and smoothing.
        length_quantile: of the extents along the heading, over the frames.
        width_quantile: of the extents across it.
        pad_m: added to both, for what the outermost points miss.
        anchor_m: standard deviation of a trusted edge.
        anchor_share: the same, a metre of range.
        outlier_deviations: anchors farther off than this lose weight (Huber).
        jerk_mps3: standard deviation of the path's jerk.
        acceleration_mps2: standard deviation of the path's acceleration.
        path_m: standard deviation of a smoothed path's step across it.
        turn_radps2: standard deviation of the change of the turning rate.
        curvature_1pm: standard deviation of the curvature, 1 / m.
        still_radps: turning rate of a body at rest.
        slip_share: distance from the centre to the rear axle, in lengths.
        shape_m: standard deviation of an outline's heading, times the length seen.
        shape_least_m: what is seen of less than this has no heading.
        shape_outlier_rad: outlines farther off than this lose weight (Huber).
        grazing_share: sine of the angle at which a side shows its extent.
        vehicle_width_m: what is wider, and never showed its length, is taken for a vehicle.
        vehicle_length_m: what is longer, and never showed its width, is too.
        vehicle_aspect: length over width of a vehicle.
        vehicle_most_width_m: width from which no more is concluded.
    """

    passes: int = 4
    length_quantile: float = 0.9
    width_quantile: float = 0.8
    pad_m: float = 0.05
    anchor_m: float = 0.1
    anchor_share: float = 0.003
    outlier_deviations: float = 2.0
    jerk_mps3: float = 3.0
    acceleration_mps2: float = 10.0
    path_m: float = 0.1
    turn_radps2: float = 0.5
    curvature_1pm: float = 0.2
    still_radps: float = 0.05
    slip_share: float = 0.3
    shape_m: float = 0.3
    shape_least_m: float = 1.0
    shape_outlier_rad: float = 0.2
    grazing_share: float = 0.15
    vehicle_width_m: float = 1.4
    vehicle_length_m: float = 3.0
    vehicle_aspect: float = 2.3
    vehicle_most_width_m: float = 1.8

    def scaled(self, metric_scale: float) -> RefinementSettings:
        """Return the settings of a world whose road scene is `metric_scale` as large."""
        names = [
            name for name in self.__dataclass_fields__ if name.endswith(("_m", "_mps3", "_mps2"))
        ]
        lengths = {name: getattr(self, name) * metric_scale for name in names}
        return replace(self, curvature_1pm=self.curvature_1pm / metric_scale, **lengths)


@dataclass(frozen=True)
class Sightings:
    """What was seen of one object, n frames, world, from above.

    Attributes:
        step: (n,) frames since the track's first, rising, from 0.
        xz: (M, 2) points of all frames, one after another, metres.
        offsets: (n + 1,) where each frame's points begin and end; no frame is empty.
        sensor: (n, 2) the sensor.
        distrusted: (n, 4) edges whose end is hidden by something nearer: rear, front, and low and
            high side across the heading.
        counts_for_size: (n,) frames whose extents may set the size.
        above_top_m: (n,) how far the sensor is above the highest point.
    """

    step: IntArray
    xz: FloatArray
    offsets: IntArray
    sensor: FloatArray
    distrusted: BoolArray
    counts_for_size: BoolArray
    above_top_m: FloatArray


@dataclass(frozen=True)
class RefinedPath:
    """A refined track on every step from its first sighting to its last.

    Attributes:
        center: (N, 2) x and z, world, metres.
        yaw_rad: (N,) heading, world, continuous.
        length: metres.
        width: metres.
        seen_length: what the points show of it; less where a vehicle's proportions filled in.
        seen_width: the same.
        residual_m: root mean square distance of the anchors to the smoothed path.
    """

    center: FloatArray
    yaw_rad: FloatArray
    length: float
    width: float
    seen_length: float
    seen_width: float
    residual_m: float
