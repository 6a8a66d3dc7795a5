//! Caps around the poles that stay in the camera's frame: a tripod below a camera that turns, and gaps between lenses.
//!
//! Two hypotheses are compared for each ring around a pole while the camera turns about the vertical: it turned with
//! the world, or it stayed with the camera. Rings from the pole outwards that stay, with rings around them that turn,
//! are a mount. A gap is flat, and ends on a circle around the pole. In front of a scene that does not change a lamp
//! or a dome looks the same, so that a person has to look at it unless it is black.
//!
//! The limits were set on rendered spheres and not on labels. A blurred cap with shades of its own is not found.

use omnilife_schemas::{
    camera::ErpCamera,
    records::{CapKind, OperatorCap, OperatorFinding, Pole},
    rgb::Mask,
};

use super::{DOUBTFUL, FOUND, LEAST_PAIRS};
use crate::motion::GreySphere;

/// Noise of differences, and least difference of what changes, of grey values of [0, 1].
const NOISE: f32 = 1.0 / 255.0;
const LEAST_CHANGE: f32 = 6.0 / 255.0;
/// Largest ratio of the change under the hypothesis that holds to that under the other one.
const LARGEST_RATIO: f32 = 0.55;
/// Least turn between the frames of a pair, columns.
const LEAST_TURN: usize = 2;
/// Caps have fewer rings than this share of all rows: 45 degrees.
const ROWS_PER_CAP: usize = 4;
/// Least number of rings of a cap.
const LEAST_RINGS: usize = 3;
/// Rings left out at the border, and rings around it that are compared.
const BORDER_RINGS: usize = 2;
const OUTER_RINGS: usize = 6;
/// Largest mean difference of a gap from its mean level, and largest level of a black one.
const FLAT: f32 = 4.0 / 255.0;
const BLACK: f32 = 8.0 / 255.0;
/// Least difference across a border, and least share of all columns with a border.
const EDGE: f32 = 10.0 / 255.0;
const LEAST_BORDER: f32 = 0.6;

/// A cap and its mask, at the size of the images.
#[derive(Debug, Clone)]
pub(super) struct Cap {
    pub(super) record: OperatorCap,
    pub(super) mask: Mask,
}

/// Means of a ring around a pole.
#[derive(Debug, Clone, Copy)]
struct Ring {
    /// Change over time if it stays with the camera, and if it turns with the world; the latter 0 without turns.
    staying: f32,
    turning: f32,
    level: f32,
    /// Mean difference from its level.
    variation: f32,
    /// Share of the columns in which the next ring outwards differs from the next one inwards.
    border: f32,
    steradians: f32,
}

/// Finds the caps at both poles in pairs of images of one size, those of a pair a second apart.
pub(super) fn find(pairs: &[[&GreySphere; 2]]) -> Vec<Cap> {
    let Some([first, _]) = pairs.first() else {
        return Vec::new();
    };
    let width = first.width(0);
    let turns: Vec<Option<usize>> = pairs.iter().map(|pair| turn(*pair)).collect();
    let turned = turns.iter().flatten().count();
    let caps = [Pole::Zenith, Pole::Nadir].map(|pole| {
        let rings = rings(pairs, &turns, pole);
        mount(&rings, turned)
            .or_else(|| gap(&rings))
            .map(|(count, cap)| Cap {
                mask: mask(width, pole, count),
                record: OperatorCap {
                    pole,
                    radius_degrees: 180.0 * count as f64 / (width / 2) as f64,
                    ..cap
                },
            })
    });
    caps.into_iter().flatten().collect()
}

/// Returns the columns by which the world turned to the left in a pair; `None` if it did not, or if a turn about the
/// vertical does not explain the change.
fn turn([first, second]: [&GreySphere; 2]) -> Option<usize> {
    let width = first.width(0);
    let band = width / 8..width * 3 / 8;
    let change = |shift: usize| -> f32 {
        let rows = band
            .clone()
            .map(|row| ring_change([first, second], row, shift));
        rows.sum::<f32>() / band.len() as f32
    };
    let still = change(0);
    let (shift, least) = (1..width)
        .map(|shift| (shift, change(shift)))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    let is_turn = least < LARGEST_RATIO * still && still >= LEAST_CHANGE;
    (is_turn && shift.min(width - shift) >= LEAST_TURN).then_some(shift)
}

/// Returns the mean difference of a row of the second image from the first one's, which is shifted to the left.
fn ring_change([first, second]: [&GreySphere; 2], row: usize, shift: usize) -> f32 {
    let width = first.width(0);
    let row = row * width..(row + 1) * width;
    let (before, after) = (&first.luma()[row.clone()], &second.luma()[row]);
    let shifted = before.iter().cycle().skip(shift);
    let sum: f32 = after.iter().zip(shifted).map(|(b, a)| (a - b).abs()).sum();
    sum / width as f32
}

/// Returns the rings from a pole outwards, with those around the largest cap.
fn rings(pairs: &[[&GreySphere; 2]], turns: &[Option<usize>], pole: Pole) -> Vec<Ring> {
    let Some([first, _]) = pairs.first() else {
        return Vec::new();
    };
    let width = first.width(0);
    let height = width / 2;
    let camera = ErpCamera {
        width: width as u32,
        height: height as u32,
    };
    let row_of = |ring: usize| match pole {
        Pole::Zenith => ring,
        Pole::Nadir => height - 1 - ring,
    };
    let count = height / ROWS_PER_CAP + BORDER_RINGS + OUTER_RINGS;
    let mean_rows: Vec<Vec<f32>> = (0..=count)
        .map(|ring| mean_row(pairs, row_of(ring), width))
        .collect();
    let ring = |number: usize| {
        let row = row_of(number);
        let changes = |shifted: bool| {
            let all = pairs.iter().zip(turns);
            let changes = all.filter_map(|(pair, turn)| match shifted {
                true => turn.map(|turn| ring_change(*pair, row, turn)),
                false => Some(ring_change(*pair, row, 0)),
            });
            mean(changes)
        };
        let values = &mean_rows[number];
        let level = mean(values.iter().copied());
        let (inner, outer) = (&mean_rows[number.saturating_sub(1)], &mean_rows[number + 1]);
        let differs = inner
            .iter()
            .zip(outer)
            .filter(|(a, b)| (*a - *b).abs() >= EDGE);
        Ring {
            staying: changes(false),
            turning: changes(true),
            level,
            variation: mean(values.iter().map(|value| (value - level).abs())),
            border: differs.count() as f32 / width as f32,
            steradians: (width as f64 * camera.pixel_solid_angle(row as u32)) as f32,
        }
    };
    (0..count).map(ring).collect()
}

fn mean_row(pairs: &[[&GreySphere; 2]], row: usize, width: usize) -> Vec<f32> {
    let pixel = |column: usize| {
        let at = row * width + column;
        mean(pairs.iter().map(|[image, _]| image.luma()[at]))
    };
    (0..width).map(pixel).collect()
}

/// Returns the mean; 0 of nothing.
fn mean(values: impl Iterator<Item = f32>) -> f32 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / f32::max(count, 1.0)
}

/// Returns the rings around a cap of so many rings.
fn around(rings: &[Ring], count: usize) -> impl Iterator<Item = &Ring> {
    rings.iter().skip(count + BORDER_RINGS).take(OUTER_RINGS)
}

fn largest_cap(rings: &[Ring]) -> usize {
    rings.len().saturating_sub(BORDER_RINGS + OUTER_RINGS)
}

/// Returns the number of rings of a mount, and its record; `None` with too few turns.
fn mount(rings: &[Ring], turned: usize) -> Option<(usize, OperatorCap)> {
    let stays = |ring: &&Ring| ring.staying < LARGEST_RATIO * (ring.turning + NOISE);
    let count = rings.iter().take_while(stays).count();
    if turned < LEAST_PAIRS || count < LEAST_RINGS || count >= largest_cap(rings) {
        return None;
    }
    let of_outer = |of: fn(&Ring) -> f32| mean(around(rings, count).map(of));
    let outer = [of_outer(|ring| ring.staying), of_outer(|ring| ring.turning)];
    if outer[0] < LEAST_CHANGE || outer[1] >= LARGEST_RATIO * outer[0] {
        return None;
    }
    let evidence = rings[..count].iter().map(|ring| {
        let excess = 255.0 * (ring.turning - ring.staying).max(0.0);
        f64::from(excess * ring.steradians)
    });
    let evidence: f64 = evidence.sum();
    let finding = match evidence {
        evidence if evidence >= FOUND => OperatorFinding::Found,
        evidence if evidence >= DOUBTFUL => OperatorFinding::Doubtful,
        _ => return None,
    };
    Some((
        count,
        record(CapKind::Mount, finding, &rings[..count], evidence),
    ))
}

/// Returns the number of rings of a gap, and its record.
fn gap(rings: &[Ring]) -> Option<(usize, OperatorCap)> {
    let is_border = |&count: &usize| rings[count].border >= LEAST_BORDER;
    let count = (LEAST_RINGS..largest_cap(rings)).find(is_border)?;
    // The first ring with a border is the last one inside, and smoothing takes that into the cap.
    let inner = &rings[..count - 1];
    let level = mean(inner.iter().map(|ring| ring.level));
    let is_flat = |ring: &Ring| ring.variation < FLAT && (ring.level - level).abs() < FLAT;
    let stays = |ring: &Ring| ring.staying < NOISE;
    if !inner.iter().all(|ring| is_flat(ring) && stays(ring)) {
        return None;
    }
    let outer = mean(around(rings, count).map(|ring| ring.staying));
    let finding = match outer >= LEAST_CHANGE || level < BLACK {
        true => OperatorFinding::Found,
        false => OperatorFinding::Doubtful,
    };
    let evidence = inner.iter().map(|ring| {
        let excess = 255.0 * (outer - ring.staying).max(0.0);
        f64::from(excess * ring.steradians)
    });
    let evidence = evidence.sum();
    let cap = record(CapKind::Gap, finding, inner, evidence);
    Some((
        count + 1,
        OperatorCap {
            border_share: f64::from(rings[count].border),
            ..cap
        },
    ))
}

/// Returns the record of a cap but for its place.
fn record(kind: CapKind, finding: OperatorFinding, rings: &[Ring], evidence: f64) -> OperatorCap {
    let levels = |of: fn(&Ring) -> f32| 255.0 * f64::from(mean(rings.iter().map(of)));
    OperatorCap {
        pole: Pole::Nadir,
        kind,
        finding,
        radius_degrees: 0.0,
        change_staying_levels: levels(|ring| ring.staying),
        change_turning_levels: levels(|ring| ring.turning),
        border_share: 0.0,
        evidence,
    }
}

fn mask(width: usize, pole: Pole, rings: usize) -> Mask {
    let height = width / 2;
    let is_inside = |row: usize| match pole {
        Pole::Zenith => row < rings,
        Pole::Nadir => row >= height - rings,
    };
    Mask {
        width,
        height,
        data: (0..width * height)
            .map(|at| 255 * u8::from(is_inside(at / width)))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;

    use super::*;

    const WIDTH: usize = 256;
    const HEIGHT: usize = 128;
    /// Rings of the painted caps: 28 degrees.
    const RINGS: usize = 20;

    /// A textured world after a turn to the left by columns, with the pixels that `carried` replaces.
    fn sphere(turn: usize, carried: impl Fn(usize, usize) -> Option<f32>) -> GreySphere {
        let level = |at: usize| {
            let (column, row) = (at % WIDTH, at / WIDTH);
            let around = TAU * (column + turn) as f32 / WIDTH as f32;
            let waves = (9.0 * around + 0.3 * row as f32).sin() + (5.0 * around).cos();
            carried(column, row).unwrap_or(0.5 + 0.15 * waves)
        };
        GreySphere::of_luma(WIDTH, (0..WIDTH * HEIGHT).map(level).collect())
    }

    /// Caps of a camera that turns by so many columns a second.
    fn caps(turn: usize, carried: impl Fn(usize, usize) -> Option<f32>) -> Vec<Cap> {
        let images: Vec<GreySphere> = (0..7)
            .map(|second| sphere(second * turn, &carried))
            .collect();
        let pairs: Vec<[&GreySphere; 2]> = (images.windows(2))
            .map(|pair| [&pair[0], &pair[1]])
            .collect();
        find(&pairs)
    }

    fn is_low(row: usize) -> bool {
        row >= HEIGHT - RINGS
    }

    /// Three legs.
    fn tripod(column: usize, row: usize) -> Option<f32> {
        let leg = (3.0 * TAU * column as f32 / WIDTH as f32).sin() > 0.3;
        is_low(row).then_some(if leg { 0.05 } else { 0.6 })
    }

    #[test]
    fn a_tripod_stays_while_the_world_turns() {
        let found = caps(5, tripod);
        assert_eq!(found.len(), 1, "{found:#?}");
        let cap = &found[0];
        assert_eq!(cap.record.pole, Pole::Nadir);
        assert_eq!(cap.record.kind, CapKind::Mount);
        assert_eq!(cap.record.finding, OperatorFinding::Found);
        assert!((cap.record.radius_degrees - 28.125).abs() < 3.0);
        assert!(cap.record.change_turning_levels > 10.0 * cap.record.change_staying_levels);
        let marked = (0..WIDTH * HEIGHT).filter(|&at| cap.mask.data[at] != 0);
        let rows = cap.record.radius_degrees / 180.0 * HEIGHT as f64;
        assert_eq!(marked.count(), WIDTH * rows.round() as usize);
        assert_eq!(cap.mask.data[WIDTH * HEIGHT - 1], 255);
    }

    #[test]
    fn a_world_without_a_cap_and_a_tripod_below_a_standing_camera_tell_nothing() {
        assert!(caps(5, |_, _| None).is_empty());
        assert!(caps(0, tripod).is_empty());
        assert!(find(&[]).is_empty());
    }

    #[test]
    fn a_flat_cap_is_a_gap_if_the_scene_moves_and_a_question_if_not() {
        let kind = |turn: usize, level: f32| {
            let found = caps(turn, |_, row| (row < RINGS).then_some(level));
            assert_eq!(found.len(), 1, "{found:#?}");
            let record = &found[0].record;
            assert_eq!((record.pole, record.kind), (Pole::Zenith, CapKind::Gap));
            assert!((record.radius_degrees - 28.125).abs() < 3.0);
            record.finding
        };
        assert_eq!(kind(5, 0.95), OperatorFinding::Found);
        assert_eq!(kind(0, 0.95), OperatorFinding::Doubtful);
        assert_eq!(kind(0, 0.0), OperatorFinding::Found);
        // Shades are a sky.
        let shaded = caps(0, |column, row| {
            (row < RINGS).then_some(0.7 + 0.2 * (TAU * column as f32 / WIDTH as f32).sin())
        });
        assert!(shaded.is_empty());
    }

    #[test]
    fn turns_are_measured_in_columns() {
        let images = [0, 7, 8].map(|turn| sphere(turn, |_, _| None));
        assert_eq!(turn([&images[0], &images[1]]), Some(7));
        assert_eq!(turn([&images[1], &images[0]]), Some(WIDTH - 7));
        assert_eq!(turn([&images[1], &images[2]]), None);
        assert_eq!(turn([&images[0], &images[0]]), None);
    }
}
