//! Queries of fields: positions on surfaces, moved by the flow, as coordinates of grids.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use omnilife_engine::{surfaces::view_angle::view_angle, trajectories::catmull_rom::KnotWeights};

use super::super::node::{FIELD_WEIGHT, Hit};

/// Returns the position of a hit on its surface: `uv`, or a unit direction.
pub(super) fn place(hit: &Hit) -> DVec3 {
    match hit {
        Hit::Plane(hit) => hit.uv.extend(0.0),
        Hit::Sphere(hit) => hit.normal,
    }
}

/// Writes a position as input of a field: in the unit square or cube.
pub(super) fn coordinates(query: DVec3, dimensions: usize, out: &mut [f32]) {
    let of_cube = if dimensions == 2 {
        query
    } else {
        0.5 * (query + 1.0)
    };
    for (out, value) in out.iter_mut().zip(of_cube.to_array()) {
        *out = value as f32;
    }
}

/// Returns the derivative of the coordinates by a query.
pub(super) fn coordinate_scale(dimensions: usize) -> f64 {
    if dimensions == 2 { 1.0 } else { 0.5 }
}

/// Returns the flow at a moment between control points.
pub(super) fn spline_of(points: &[f32], dimensions: usize, weights: &KnotWeights) -> DVec3 {
    let mut flow = [0.0; 3];
    for (&knot, weight) in weights.knots.iter().zip(weights.weights) {
        let point = &points[knot * dimensions..(knot + 1) * dimensions];
        for (flow, value) in flow.iter_mut().zip(point) {
            *flow += weight * f64::from(*value);
        }
    }
    DVec3::from_array(flow)
}

/// Returns the query of a position after the flow.
pub(super) fn moved(at: DVec3, flow: DVec3, dimensions: usize) -> DVec3 {
    if dimensions == 2 {
        return at + FIELD_WEIGHT * flow;
    }
    let tangent = flow - flow.dot(at) * at;
    (at + FIELD_WEIGHT * tangent).normalize()
}

/// Returns the gradients of [`moved`] by the position and by the flow.
pub(super) fn moved_vjp(
    at: DVec3,
    flow: DVec3,
    dimensions: usize,
    upstream: DVec3,
) -> (DVec3, DVec3) {
    if dimensions == 2 {
        return (upstream, FIELD_WEIGHT * upstream);
    }
    let tangent = flow - flow.dot(at) * at;
    let unscaled = at + FIELD_WEIGHT * tangent;
    let length = unscaled.length();
    let query = unscaled / length;
    let by_unscaled = (upstream - upstream.dot(query) * query) / length;
    let by_tangent = FIELD_WEIGHT * by_unscaled;
    let by_flow = by_tangent - by_tangent.dot(at) * at;
    let by_at = by_unscaled - flow.dot(at) * by_tangent - by_tangent.dot(at) * flow;
    (by_at, by_flow)
}

/// Returns the coordinates of the view field: the query and the angle, each in [0, 1].
pub(super) fn view_coordinates(query: DVec3, hit: &Hit) -> [f32; 4] {
    let Hit::Plane(hit) = hit else {
        return [0.0; 4];
    };
    let angle = (view_angle(hit.direction) + PI) / TAU;
    [query.x, query.y, angle.x, angle.y].map(|value| value as f32)
}

pub(super) fn add_coordinates(
    by_query: &mut [DVec3],
    by_positions: &[f32],
    dimensions: usize,
    scale: f64,
) {
    for (query, by) in by_query
        .iter_mut()
        .zip(by_positions.chunks_exact(dimensions))
    {
        for (axis, value) in by.iter().enumerate() {
            query[axis] += scale * f64::from(*value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_of_the_flow_are_central_differences() {
        let at = DVec3::new(0.4, -0.5, 0.7).normalize();
        let (flow, upstream) = (DVec3::new(0.9, 0.3, -0.6), DVec3::new(-0.7, 0.2, 0.8));
        for dimensions in [2, 3] {
            let (by_at, by_flow) = moved_vjp(at, flow, dimensions, upstream);
            let value = |at: DVec3, flow: DVec3| upstream.dot(moved(at, flow, dimensions));
            for axis in DVec3::AXES {
                let step = 1e-6 * axis;
                let expected = (value(at + step, flow) - value(at - step, flow)) / 2e-6;
                assert!((by_at.dot(axis) - expected).abs() < 1e-8);
                let expected = (value(at, flow + step) - value(at, flow - step)) / 2e-6;
                assert!((by_flow.dot(axis) - expected).abs() < 1e-8);
            }
        }
    }
}
