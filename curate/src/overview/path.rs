//! Path of the camera from above, as SVG.

use glam::{DVec2, DVec3, dvec2};
use maud::{Markup, html};
use omnilife_schemas::{
    Similarity,
    records::{Scale, Scene},
    trajectory::GroundAxes,
};

/// Size of the figure in its own units.
const SIZE: [f64; 2] = [480.0, 300.0];
/// Room around the path for marks and labels.
const MARGIN: f64 = 34.0;
/// Cameras farther than this from the middle of the others are mistakes and are left out, in radii of the others.
const MOST_RADII: f64 = 2.0;
/// Viewing directions that are drawn, and their length.
const MOST_DIRECTIONS: usize = 12;
const DIRECTION_LENGTH: f64 = 13.0;
/// Longest scale bar as a share of the width.
const MOST_BAR: f64 = 0.25;
/// Least cosine of the angle between the cameras' up and -y in a world with y down.
const LEAST_Y_DOWN: f64 = 0.7;

/// Posed camera from above.
struct Camera {
    /// Position along the ground, to the right and up in the figure.
    at: DVec2,
    /// Viewing direction in the same axes, up to unit length; short where it looks up or down.
    ahead: DVec2,
    /// True where the frame before it has no pose.
    begins: bool,
}

pub(super) struct CameraPath {
    cameras: Vec<Camera>,
    /// Cameras far off all others, which are not drawn.
    pub(super) far: usize,
    /// Frames with a pose.
    pub(super) posed: usize,
    /// Length of the path in world units, gaps bridged.
    pub(super) length: f64,
    pub(super) unit: &'static str,
    /// Directions of the figure.
    pub(super) directions: &'static str,
}

impl CameraPath {
    /// Makes the path of a scene; `None` without poses.
    pub(super) fn of(scene: &Scene) -> Option<Self> {
        let poses = scene.frames.iter().map(|frame| {
            let pose = frame.pose.as_ref()?;
            Some((pose.rotation()?, pose.centre()))
        });
        let poses: Vec<_> = poses.collect();
        let centres: Vec<DVec3> = poses.iter().flatten().map(|(_, centre)| *centre).collect();
        let around = Similarity::from_most_cameras(&centres)?;
        let middle = DVec3::from_array(around.offset);
        let up: DVec3 = (poses.iter().flatten())
            .map(|(rotation, _)| *rotation * DVec3::NEG_Y)
            .sum();
        let up = up.normalize_or(DVec3::NEG_Y);
        let (right, top, directions) = if up.dot(DVec3::NEG_Y) >= LEAST_Y_DOWN {
            (DVec3::X, DVec3::Z, "x to the right and z up")
        } else {
            let axes = GroundAxes::new(up).to_world;
            (axes.x_axis, axes.y_axis, "across the cameras' mean up")
        };
        let seen = |place: DVec3| dvec2(place.dot(right), place.dot(top));
        let mut cameras: Vec<Camera> = Vec::new();
        let mut places: Vec<DVec3> = Vec::new();
        let mut begins = true;
        for pose in poses {
            let drawn =
                pose.filter(|(_, centre)| (*centre - middle).length() * around.scale <= MOST_RADII);
            if let Some((rotation, centre)) = drawn {
                cameras.push(Camera {
                    at: seen(centre),
                    ahead: seen(rotation * DVec3::Z),
                    begins,
                });
                places.push(centre);
            }
            begins = drawn.is_none();
        }
        let steps = places.windows(2).map(|pair| pair[0].distance(pair[1]));
        Some(Self {
            far: centres.len() - cameras.len(),
            posed: centres.len(),
            length: steps.sum::<f64>() + 0.0,
            unit: match scene.scale {
                Scale::Metres => "m",
                Scale::Arbitrary => "units",
            },
            directions,
            cameras,
        })
    }

    /// Draws the path; `label` describes it for screen readers.
    pub(super) fn svg(&self, label: &str) -> Markup {
        let low = self
            .cameras
            .iter()
            .fold(DVec2::MAX, |low, one| low.min(one.at));
        let high = self
            .cameras
            .iter()
            .fold(DVec2::MIN, |high, one| high.max(one.at));
        let room = DVec2::from_array(SIZE) - 2.0 * MARGIN;
        let ratios = room / (high - low).max(DVec2::splat(f64::MIN_POSITIVE));
        let scale = Some(ratios.min_element()).filter(|scale| *scale < 1e12);
        let units = scale.unwrap_or(0.0);
        let middle = (low + high) / 2.0;
        let place = |at: DVec2| {
            let from_middle = (at - middle) * units;
            dvec2(SIZE[0] / 2.0 + from_middle.x, SIZE[1] / 2.0 - from_middle.y)
        };
        let places: Vec<DVec2> = self.cameras.iter().map(|one| place(one.at)).collect();
        let lines: Vec<String> = lines(&self.cameras, &places);
        let every = self.cameras.len().div_ceil(MOST_DIRECTIONS).max(1);
        let directions = self.cameras.iter().zip(&places).step_by(every);
        let directions: Vec<String> = directions
            .map(|(camera, at)| {
                let end = *at + dvec2(camera.ahead.x, -camera.ahead.y) * DIRECTION_LENGTH;
                format!("M{} L{}", pair(*at), pair(end))
            })
            .collect();
        html! {
            svg.path viewBox={ "0 0 " (SIZE[0]) " " (SIZE[1]) } role="img" aria-label=(label) {
                @for points in &lines { polyline.line points=(points) {} }
                path.direction d=(directions.join(" ")) {}
                @if let Some(arrow) = arrow(&places) { polygon.end points=(arrow) {} }
                @if let Some(first) = places.first() {
                    circle.start cx=(number(first.x)) cy=(number(first.y)) r="5" {}
                    text x=(number(first.x + 9.0)) y=(number(first.y + 17.0)) { "start" }
                }
                @if let Some(scale) = scale { (self.bar(scale)) }
            }
        }
    }

    /// Returns a bar of a round length.
    fn bar(&self, scale: f64) -> Markup {
        let longest = SIZE[0] * MOST_BAR / scale;
        let decade = 10_f64.powi(longest.log10().floor() as i32);
        let factor = [5.0, 2.0]
            .into_iter()
            .find(|factor| decade * factor <= longest);
        let length = decade * factor.unwrap_or(1.0);
        let (left, bottom) = (MARGIN / 2.0, SIZE[1] - 10.0);
        let right = left + length * scale;
        html! {
            path.bar d=(format!("M{left} {} V{bottom} H{} V{}", bottom - 6.0, number(right), bottom - 6.0)) {}
            text x=(number(right + 6.0)) y=(bottom) { (length) " " (self.unit) }
        }
    }
}

/// Returns the points of every stretch without gaps.
fn lines(cameras: &[Camera], places: &[DVec2]) -> Vec<String> {
    let mut lines: Vec<Vec<String>> = Vec::new();
    for (camera, at) in cameras.iter().zip(places) {
        match lines.last_mut().filter(|_| !camera.begins) {
            Some(line) => line.push(pair(*at)),
            None => lines.push(vec![pair(*at)]),
        }
    }
    lines.iter().map(|line| line.join(" ")).collect()
}

/// Returns the corners of an arrow head at the end of the path, in its last direction; `None` for a camera that stands.
fn arrow(places: &[DVec2]) -> Option<String> {
    let end = *places.last()?;
    let before = places.iter().rev().find(|at| at.distance(end) > 3.0)?;
    let ahead = (end - *before).normalize();
    let aside = ahead.perp() * 5.0;
    let back = end - ahead * 6.0;
    let corners = [end + ahead * 6.0, back + aside, back - aside];
    Some(corners.map(pair).join(" "))
}

fn pair(at: DVec2) -> String {
    format!("{},{}", number(at.x), number(at.y))
}

/// Returns a coordinate to a tenth.
fn number(value: f64) -> String {
    // The sum turns -0 into 0.
    ((value * 10.0).round() / 10.0 + 0.0).to_string()
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat};
    use omnilife_schemas::{Pose, camera::ErpCamera, records::SceneFrame};

    use super::*;

    #[test]
    fn a_world_with_z_up_is_seen_from_above_too() {
        // Right is x, down is -z, ahead is y.
        let upright = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
        let frame = |place: DVec3| {
            SceneFrame::new(
                "0.png".to_owned(),
                0.0,
                Some(Pose::new(DQuat::from_mat3(&upright), place)),
            )
        };
        let places = [[0.0, 0.0, 1.5], [0.0, 5.0, 1.5], [5.0, 5.0, 3.0]];
        let scene = Scene {
            scale: Scale::Metres,
            ..Scene::given(
                "walk/seq-000",
                ErpCamera::new(64, 32),
                places.map(DVec3::from_array).map(frame).into(),
            )
        };
        let path = CameraPath::of(&scene).expect("poses");
        let near = |found: DVec2, x: f64, y: f64| found.distance(dvec2(x, y)) < 1e-9;
        assert!(near(path.cameras[1].at, 0.0, 5.0) && near(path.cameras[2].at, 5.0, 5.0));
        assert!(near(path.cameras[0].ahead, 0.0, 1.0));
        assert_eq!(path.directions, "across the cameras' mean up");
    }

    fn camera(x: f64, z: f64, begins: bool) -> Camera {
        Camera {
            at: dvec2(x, z),
            ahead: dvec2(0.0, 1.0),
            begins,
        }
    }

    fn path(cameras: Vec<Camera>) -> CameraPath {
        CameraPath {
            posed: cameras.len(),
            far: 0,
            length: 0.0,
            unit: "m",
            directions: "",
            cameras,
        }
    }

    #[test]
    fn axes_are_equal_and_z_points_up() {
        let cameras = vec![
            camera(0.0, 0.0, true),
            camera(0.0, 10.0, false),
            camera(5.0, 10.0, false),
        ];
        let drawn = path(cameras).svg("a path").into_string();
        // 300 - 2 * 34 units of the figure for 10 m.
        assert!(
            drawn.contains(r#"points="182,266 182,34 298,34""#),
            "{drawn}"
        );
        assert!(drawn.contains("5 m</text>"), "{drawn}");
    }

    #[test]
    fn gaps_break_the_line_and_a_standing_camera_is_a_dot() {
        let gap = vec![
            camera(0.0, 0.0, true),
            camera(1.0, 0.0, false),
            camera(3.0, 0.0, true),
        ];
        let drawn = path(gap).svg("a path").into_string();
        assert_eq!(drawn.matches("<polyline").count(), 2, "{drawn}");
        let still = path(vec![camera(2.0, 2.0, true), camera(2.0, 2.0, false)]);
        let drawn = still.svg("a path").into_string();
        assert!(drawn.contains(r#"cx="240" cy="150""#), "{drawn}");
        assert!(
            !drawn.contains("polygon") && !drawn.contains("NaN"),
            "{drawn}"
        );
    }
}
