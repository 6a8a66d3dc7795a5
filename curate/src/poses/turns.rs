//! Rotations of a camera that rotates or hovers: its images show no parallax.

use glam::{DMat3, DQuat, DVec3};
use omnilife_schemas::{
    Pose, RgbImage,
    camera::{Camera, PinholeCamera},
};

use crate::motion::pinhole_turns::{GreyFrame, Turns, turns};

/// Least share of fitting pixels at which neighbouring frames count as registered.
const GOOD_FIT: f64 = 0.8;
/// Step from a focal length to those beside it, of its logarithm.
const FOCAL_STEP: f64 = 0.14;
/// A path of the image's middle below this is static, pixels.
const STILL: f64 = 2.0;

/// The rotations of a clip as poses.
pub(crate) struct RegisteredTurns {
    /// With square pixels and a centred principal point.
    pub(crate) camera: Camera,
    /// One per frame, all in one place.
    pub(crate) poses: Vec<Option<Pose>>,
    /// Result and quality of the fit.
    pub(crate) reason: String,
    /// True if enough of the images fits everywhere.
    pub(crate) succeeded: bool,
}

/// Returns a pinhole with square pixels and a centred principal point; the focal length is in pixels.
pub(crate) fn pinhole([width, height]: [usize; 2], focal: f64) -> Camera {
    PinholeCamera {
        width: width as u32,
        height: height as u32,
        fx: focal,
        fy: focal,
        cx: 0.5 * width as f64,
        cy: 0.5 * height as f64,
    }
    .into()
}

/// Returns luma of [0, 255] with the usable pixels.
pub(crate) fn grey_frame(image: &RgbImage, open: Vec<bool>) -> GreyFrame {
    let pixels = image.data.as_chunks::<3>().0.iter();
    GreyFrame {
        width: image.width,
        height: image.height,
        luma: pixels
            .map(|[r, g, b]| 255.0 * (0.2126 * r + 0.7152 * g + 0.0722 * b))
            .collect(),
        open,
    }
}

/// Estimates the rotations of a camera in place, from frames of one size; its focal length is in pixels, if known.
pub(crate) fn registered(
    frames: &[GreyFrame],
    size: [usize; 2],
    focal: Option<f64>,
) -> RegisteredTurns {
    let found = turns(frames, focal.map(|focal| focal / size[0] as f64));
    let lens = match focal {
        Some(_) => "a given focal length".to_owned(),
        None => format!(
            "a focal length of {:.2} widths, the best of a grid",
            found.focal
        ),
    };
    of_turns(&found, size, &lens)
}

/// Makes the poses of rotations; `lens` tells the origin of the focal length.
fn of_turns(found: &Turns, size: [usize; 2], lens: &str) -> RegisteredTurns {
    let width = size[0] as f64;
    let pixels = found.path * width;
    let succeeded = found.least_fit >= GOOD_FIT;
    let is_still = succeeded && pixels < STILL;
    let fit = format!(
        "at least {:.0} % of the pixels fit ({:.0} % expected)",
        100.0 * found.least_fit,
        100.0 * GOOD_FIT
    );
    let path = format!("the image's middle moves by {pixels:.1} pixels in all");
    let reason = match (succeeded, is_still) {
        (false, _) => format!("turns of uncertain registration, {lens}: {fit}; {path}"),
        (true, true) => format!("a still camera, {lens}: {fit}; {path}"),
        (true, false) => format!("turns, {lens}: {fit}; {path}"),
    };
    let poses = found.rotations.iter().map(|&rotation| {
        let rotation = if is_still { DQuat::IDENTITY } else { rotation };
        Pose::from_matrix(DMat3::from_quat(rotation), DVec3::ZERO)
    });
    RegisteredTurns {
        camera: pinhole(size, found.focal * width),
        poses: poses.collect(),
        reason,
        succeeded,
    }
}

/// Estimates the rotations of a camera in place with a focal length between those of the grid: of the least of a
/// parabola through the costs of three, over the logarithm. The one with the least cost of all four is kept. A still
/// camera determines none, and keeps that of the grid.
pub(super) fn registered_finely(frames: &[GreyFrame], size: [usize; 2]) -> RegisteredTurns {
    let first = turns(frames, None);
    let grid = first.focal;
    let at = |logarithm: f64| turns(frames, Some(grid * logarithm.exp()));
    let best = if first.path * (size[0] as f64) < STILL {
        first
    } else {
        let [shorter, longer] = [-FOCAL_STEP, FOCAL_STEP].map(at);
        let slope = longer.cost - shorter.cost;
        let bend = shorter.cost + longer.cost - 2.0 * first.cost;
        let least = (-0.5 * FOCAL_STEP * slope / bend).clamp(-FOCAL_STEP, FOCAL_STEP);
        let finest = (bend > 0.0 && least.is_finite()).then(|| at(least));
        let others = [shorter, longer].into_iter().chain(finest);
        others.fold(
            first,
            |best, other| {
                if other.cost < best.cost { other } else { best }
            },
        )
    };
    let lens = format!("a focal length of {:.3} widths, fitted", best.focal);
    of_turns(&best, size, &lens)
}

/// Returns the focal length of a pinhole, pixels; that of a sphere is 0.
pub(super) fn focal_pixels(camera: Camera) -> f64 {
    match camera {
        Camera::Pinhole(camera) => camera.fx,
        Camera::Erp(_) => 0.0,
    }
}
