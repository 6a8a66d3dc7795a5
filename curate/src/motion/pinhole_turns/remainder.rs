//! Shifts that rotations leave between frames.
//!
//! Frames a third of the clip apart are registered by one rotation. Small blocks are then aligned by themselves, with a
//! difference in brightness of their own (Lucas and Kanade, "An Iterative Image Registration Technique", IJCAI 1981).
//! A camera in one place leaves no shifts. One that moves leaves some even over a plane: rotations follow the middle of
//! the image, and not its border.

use glam::{DMat3, DQuat, DVec2, DVec3};
use omnilife_schemas::statistics::median;
use rayon::prelude::*;

use super::{GreyFrame, Pyramid, register};

/// Maximum number of compared pairs of frames.
const PAIRS: usize = 12;
/// Pixels between the middles of neighbouring blocks.
const SPACING: usize = 16;
/// Pixels from the middle of a block to its sides, and the largest shift.
const REACH: usize = 7;
/// Steps of Gauss-Newton for a block.
const STEPS: usize = 8;
/// A shorter step ends them, pixels.
const LEAST_STEP: f64 = 0.01;
/// Least variance of the slope of luma along any direction of a block, squares of a 255th per pixel.
const LEAST_DETAIL: f64 = 9.0;
/// Least share of a block's pixels that both frames show.
const LEAST_SHOWN: f64 = 0.5;
/// Least number of blocks with detail that a pair must share.
const LEAST_BLOCKS: usize = 20;

/// Returns the shift that rotations leave between frames a third of the clip apart, in widths of the image: the median
/// over blocks with detail, of the pair with the largest.
///
/// `rotations` lead from the cameras to one world; `focal` is the focal length over the width. `None` if no pair shares
/// 20 blocks with detail.
pub fn remainder(frames: &[GreyFrame], rotations: &[DQuat], focal: f64) -> Option<f64> {
    let gap = (frames.len() / 3).max(1);
    let pairs = frames.len().min(rotations.len()).saturating_sub(gap);
    let step = pairs.div_ceil(PAIRS).max(1);
    let numbers: Vec<usize> = (0..pairs).step_by(step).collect();
    let left: Vec<f64> = numbers
        .into_par_iter()
        .filter_map(|number| {
            let [first, second] = [number, number + gap].map(|frame| Pyramid::of(&frames[frame]));
            let guess = (rotations[number + gap].inverse() * rotations[number]).normalize();
            let rotation = register(&first, &second, focal, guess).rotation;
            of_pair(first.0.first()?, second.0.first()?, focal, rotation)
        })
        .collect();
    left.into_iter().reduce(f64::max)
}

/// Returns the median shift of a pair's blocks, in widths; `None` if it shares too few.
fn of_pair(first: &GreyFrame, second: &GreyFrame, focal: f64, rotation: DQuat) -> Option<f64> {
    let width = first.width as f64;
    let focal = focal * width;
    let middle = 0.5 * DVec2::new(width - 1.0, first.height as f64 - 1.0);
    let turn = DMat3::from_quat(rotation);
    let place = |pixel: DVec2| {
        let point = turn * ((pixel - middle) / focal).extend(1.0);
        (point.z > 0.1).then(|| focal * point.truncate() / point.z + middle)
    };
    let mut shifts = Vec::new();
    for row in (REACH..first.height.saturating_sub(REACH)).step_by(SPACING) {
        for column in (REACH..first.width.saturating_sub(REACH)).step_by(SPACING) {
            shifts.extend(shift_of_block(first, second, &place, [column, row]));
        }
    }
    let shift = median(&shifts).filter(|_| shifts.len() >= LEAST_BLOCKS)?;
    Some(shift / width)
}

/// Returns the length of a block's shift from its `place` in the second frame, pixels, at most [`REACH`]; `None` if it
/// has too little detail, or the second frame shows too little of it.
fn shift_of_block(
    first: &GreyFrame,
    second: &GreyFrame,
    place: &impl Fn(DVec2) -> Option<DVec2>,
    middle: [usize; 2],
) -> Option<f64> {
    let [columns, rows] = middle.map(|at| at - REACH..=at + REACH);
    let all = ((2 * REACH + 1) * (2 * REACH + 1)) as f64;
    let mut shift = DVec2::ZERO;
    for _ in 0..STEPS {
        let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for row in rows.clone() {
            for column in columns.clone() {
                let pixel = row * first.width + column;
                let at = place(DVec2::new(column as f64, row as f64));
                let at = at.filter(|_| first.open[pixel]);
                let Some((luma, by_place)) = at.and_then(|at| second.sample(at + shift)) else {
                    continue;
                };
                // The third unknown is the difference in brightness.
                let slope = by_place.extend(1.0);
                matrix += DMat3::from_cols(slope * slope.x, slope * slope.y, slope);
                right += (luma - f64::from(first.luma[pixel])) * slope;
            }
        }
        if matrix.z_axis.z < LEAST_SHOWN * all || detail(&matrix) < LEAST_DETAIL {
            return None;
        }
        let step = -(matrix.inverse() * right).truncate();
        shift += step;
        if !shift.is_finite() {
            return None;
        }
        if shift.length() > REACH as f64 {
            return Some(REACH as f64);
        }
        if step.length() < LEAST_STEP {
            break;
        }
    }
    Some(shift.length())
}

/// Returns the least variance of the slope along any direction, from the sums of a block's normal equations.
fn detail(matrix: &DMat3) -> f64 {
    let count = matrix.z_axis.z.max(1.0);
    let mean = matrix.z_axis.truncate() / count;
    let xx = matrix.x_axis.x / count - mean.x * mean.x;
    let yy = matrix.y_axis.y / count - mean.y * mean.y;
    let xy = matrix.x_axis.y / count - mean.x * mean.y;
    0.5 * (xx + yy) - (0.5 * (xx - yy)).hypot(xy)
}

#[cfg(test)]
pub(crate) mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use super::*;

    const WIDTH: usize = 160;
    const HEIGHT: usize = 90;
    /// Focal length over the width.
    pub(crate) const FOCAL: f64 = 0.8;

    /// Returns 160x90 pixels of luma of the ground, which is at a distance of 1, or of a roof in a quarter of it.
    pub(crate) fn frame(rotation: DQuat, centre: DVec3, roof: f64) -> GreyFrame {
        let middle = 0.5 * DVec2::new(WIDTH as f64 - 1.0, HEIGHT as f64 - 1.0);
        let luma = |at: DVec2| {
            let wave = (31.0 * at.x + 9.0 * at.y).sin()
                + (23.0 * at.y - 13.0 * at.x).cos()
                + (17.0 * at.x * at.y + 29.0 * at.y).sin();
            128.0 + 30.0 * wave
        };
        let pixel = |number: usize| {
            let place = DVec2::new((number % WIDTH) as f64, (number / WIDTH) as f64);
            let ray = rotation * ((place - middle) / (FOCAL * WIDTH as f64)).extend(1.0);
            let meet =
                |height: f64| (centre + ray * ((1.0 - height - centre.z) / ray.z)).truncate();
            let top = meet(roof);
            let at = if top.x < 0.0 && top.y < 0.0 {
                top
            } else {
                meet(0.0)
            };
            luma(at) as f32
        };
        GreyFrame {
            width: WIDTH,
            height: HEIGHT,
            luma: (0..WIDTH * HEIGHT).map(pixel).collect(),
            open: vec![true; WIDTH * HEIGHT],
        }
    }

    /// Returns the shift that is left of a clip, pixels: the camera turns, and moves by so much of its height.
    fn left(motion: DVec3, roof: f64) -> Option<f64> {
        let turns: Vec<DQuat> = (0..6)
            .map(|number| {
                let number = f64::from(number);
                DQuat::from_scaled_axis(DVec3::new(
                    0.01 * number.sin(),
                    0.008 * number,
                    0.01 * number,
                ))
            })
            .collect();
        let frames: Vec<GreyFrame> = (turns.iter().enumerate())
            .map(|(number, &turn)| frame(turn, motion * (number as f64 / 5.0), roof))
            .collect();
        remainder(&frames, &turns, FOCAL).map(|widths| widths * WIDTH as f64)
    }

    #[test]
    fn a_camera_in_one_place_leaves_nothing_and_one_that_moves_does() {
        let hover = left(DVec3::ZERO, 0.2).unwrap();
        assert!(hover < 0.05, "{hover}");
        // Along the ground, up, and past a roof; the limit of a hovering camera is a quarter of a pixel here.
        for motion in [0.3 * DVec3::X, 0.1 * DVec3::Z] {
            let pixels = left(motion, 0.2).unwrap();
            assert!(pixels > 0.5, "{motion}: {pixels}");
        }
        // A third of the clip as one gap: the farther the camera has come, the more is left.
        let steps = [0.05, 0.1, 0.2].map(|way| left(way * DVec3::X, 0.0).unwrap());
        assert!(steps.is_sorted() && steps[0] > hover, "{steps:?}");
    }

    #[test]
    fn bare_ground_and_single_frames_tell_nothing() {
        let bare = GreyFrame {
            luma: vec![90.0; WIDTH * HEIGHT],
            ..frame(DQuat::IDENTITY, DVec3::ZERO, 0.0)
        };
        let frames = vec![bare; 3];
        assert_eq!(remainder(&frames, &[DQuat::IDENTITY; 3], FOCAL), None);
        assert_eq!(remainder(&frames[..1], &[DQuat::IDENTITY], FOCAL), None);
    }
}
