//! Heading and size of objects.

use glam::{DMat3, DVec2, DVec3};
use omnilife_schemas::{
    camera::CameraModel,
    oriented_box::OrientedBox,
    posed_view::PosedView,
    statistics,
    trajectory::{BSpline, GroundAxes, ObjectPath, nearest_turn},
};

/// Least speed at which the heading is that of the velocity, metres per second; below it, the heading is kept.
const LEAST_SPEED: f64 = 0.5;
/// Headings are sampled this often, seconds.
const HEADING_INTERVAL_SECONDS: f64 = 0.25;
/// Maximum number of detections, evenly spaced, whose boxes the size is fitted to.
const MOST_BOXES: usize = 24;
/// Largest length of a car, metres.
const LONGEST_CAR: f64 = 5.2;

/// Returns the path of an object on the ground with its headings along the motion.
pub fn with_headings(centre: BSpline, axes: &GroundAxes, metres_per_unit: f64) -> ObjectPath {
    let [begin, end] = centre.range();
    let samples = ((end - begin) / HEADING_INTERVAL_SECONDS).ceil().max(1.0) as usize;
    let (mut seconds, mut headings) = (Vec::new(), Vec::<f64>::new());
    for sample in 0..=samples {
        let time = begin + (end - begin) * sample as f64 / samples as f64;
        let velocity = centre.velocity(time);
        let along = velocity - axes.to_world.z_axis * velocity.dot(axes.to_world.z_axis);
        let is_later = seconds.last().is_none_or(|&last| time > last);
        if along.length() * metres_per_unit > LEAST_SPEED && is_later {
            let heading = axes.heading(along);
            headings.push(
                headings
                    .last()
                    .map_or(heading, |&last| nearest_turn(heading, last)),
            );
            seconds.push(time);
        }
    }
    if headings.is_empty() {
        // Too slow throughout: the heading is that of its displacement.
        let way = centre.position(end) - centre.position(begin);
        (seconds, headings) = (vec![begin], vec![axes.heading(way)]);
    }
    ObjectPath {
        centre,
        heading_seconds: seconds,
        headings,
    }
}

/// Returns the edges of the box of an object in an image, pixels. `None` if a corner is not in front of the camera.
pub fn projected_edges(
    view: &PosedView,
    centre: DVec3,
    rotation: DMat3,
    dimensions: [f64; 3],
) -> Option<[[DVec2; 2]; 12]> {
    let corners = projected_corners(view, centre, rotation, dimensions)?;
    Some(OrientedBox::EDGES.map(|edge| edge.map(|corner| corners[corner])))
}

/// Returns the corners of the box of an object in an image, pixels. `None` if one is not in front of the camera.
fn projected_corners(
    view: &PosedView,
    centre: DVec3,
    rotation: DMat3,
    dimensions: [f64; 3],
) -> Option<[DVec2; 8]> {
    let of_object = OrientedBox {
        centre,
        axes: rotation,
        half: 0.5 * DVec3::from_array(dimensions),
    };
    let mut pixels = [DVec2::ZERO; 8];
    for (pixel, corner) in pixels.iter_mut().zip(of_object.corners()) {
        *pixel = view.camera.project(view.in_camera(corner))?;
    }
    Some(pixels)
}

/// Returns the box of an object in an image: left, top, width and height of the hull of its corners. `None` if a corner
/// is not in front of the camera.
pub fn projected_box(
    view: &PosedView,
    centre: DVec3,
    rotation: DMat3,
    dimensions: [f64; 3],
) -> Option<[f64; 4]> {
    let corners = projected_corners(view, centre, rotation, dimensions)?;
    let low = corners.into_iter().fold(DVec2::INFINITY, DVec2::min);
    let high = corners.into_iter().fold(DVec2::NEG_INFINITY, DVec2::max);
    let size = high - low;
    Some([low.x, low.y, size.x, size.y])
}

/// Returns length, width and height (metres) of the vehicle whose boxes along a path fit the detected ones best: the
/// median difference of their sides is the least. Its height is that of its class; it is not visible from above.
pub fn dimensions(
    path: &ObjectPath,
    axes: &GroundAxes,
    boxes: &[(&PosedView, [f64; 4])],
    metres_per_unit: f64,
) -> [f64; 3] {
    let step = boxes.len().div_ceil(MOST_BOXES).max(1);
    let some: Vec<_> = boxes.iter().step_by(step).collect();
    let misfit = |dimensions: [f64; 3]| -> f64 {
        let sides = dimensions.map(|metres| metres / metres_per_unit);
        let differences: Vec<f64> = some
            .iter()
            .filter_map(|(view, detected)| {
                let (centre, heading) = path.at(view.seconds)?;
                let [_, _, width, height] =
                    projected_box(view, centre, axes.rotation(heading), sides)?;
                Some((width - detected[2]).abs() + (height - detected[3]).abs())
            })
            .collect();
        statistics::median(&differences).unwrap_or(0.0)
    };
    candidates()
        .into_iter()
        .map(|dimensions| (misfit(dimensions), dimensions))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(CAR, |(_, dimensions)| dimensions)
}

/// Size of a vehicle of unknown size, metres.
pub const CAR: [f64; 3] = [4.5, 1.8, 1.5];

/// Returns sizes of vehicles, the most frequent first.
fn candidates() -> Vec<[f64; 3]> {
    let mut all = vec![CAR];
    let mut length = 3.5;
    while length <= 14.0 {
        let (widths, height) = if length <= LONGEST_CAR {
            ([1.6, 1.8, 2.0], 1.5)
        } else if length <= 8.0 {
            ([1.9, 2.1, 2.3], 2.4)
        } else {
            ([2.2, 2.4, 2.6], 3.2)
        };
        all.extend(widths.map(|width| [length, width, height]));
        length += 0.2;
    }
    all
}

#[cfg(test)]
mod tests {
    use glam::dvec3;
    use omnilife_schemas::camera::PinholeCamera;

    use super::*;

    fn straight(stop: f64) -> BSpline {
        BSpline {
            degree: 1,
            knots: vec![0.0, 0.0, 4.0, 8.0, 12.0, 12.0],
            coefficients: vec![
                [0.0, 0.0, 0.75],
                [20.0, 0.0, 0.75],
                [20.0 + stop, 0.0, 0.75],
                [20.0, 20.0, 0.75],
            ],
        }
    }

    #[test]
    fn headings_follow_the_motion_and_are_held_at_standstill() {
        let axes = GroundAxes::new(DVec3::Z);
        let path = with_headings(straight(0.0), &axes, 1.0);
        assert!(path.heading(2.0).abs() < 1e-9);
        // Standing still from 4 s to 8 s: nothing between is sampled.
        assert!(
            path.heading_seconds
                .iter()
                .all(|&time| !(4.1..7.9).contains(&time))
        );
        assert!((path.heading(11.0) - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
        let still = BSpline {
            degree: 0,
            knots: vec![1.0, 1.0],
            coefficients: vec![[1.0, 2.0, 3.0]],
        };
        assert_eq!(with_headings(still, &axes, 1.0).fault(), None);
    }

    #[test]
    fn sizes_are_those_whose_boxes_fit() {
        let axes = GroundAxes::new(DVec3::Z);
        let path = with_headings(straight(0.0), &axes, 1.0);
        let views: Vec<PosedView> = (0..12)
            .map(|frame| PosedView {
                frame,
                seconds: f64::from(frame),
                camera: PinholeCamera::with_horizontal_field_of_view(640, 360, 1.1).into(),
                to_world: DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z),
                centre: dvec3(12.0, 5.0, 45.0),
            })
            .collect();
        for truth in [[4.3, 1.8, 1.5], [6.7, 2.1, 2.4]] {
            let boxes: Vec<(&PosedView, [f64; 4])> = views
                .iter()
                .filter_map(|view| {
                    let (centre, heading) = path.at(view.seconds)?;
                    Some((
                        view,
                        projected_box(view, centre, axes.rotation(heading), truth)?,
                    ))
                })
                .collect();
            let found = dimensions(&path, &axes, &boxes, 1.0);
            for (found, truth) in found.iter().zip(truth) {
                assert!((found - truth).abs() < 0.25, "{found} {truth}");
            }
        }
        assert_eq!(dimensions(&path, &axes, &[], 1.0), CAR);
    }
}
