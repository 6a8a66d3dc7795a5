//! Moments of a dynamic scene: static Gaussians once, dynamic ones at each moment.
//!
//! The only input is a parameterization's Gaussians at a time, so that every dynamic method has moments:
//! Gaussians with times of their own, objects on paths, Gaussians that a network deforms.

use omnilife_engine::{
    clock::TimeSpan,
    gaussians::{
        ActivatedGaussians, SH_C0, parameterization::Viewpoint, temporal::TemporalFeatures,
    },
    model::Model,
};
use rayon::prelude::*;

use omnilife_training::formats::splat::{MOST_ROWS, SplatRow};

/// Default maximum number of moments; the clip's number of frames is another.
const MOST_MOMENTS: usize = 60;
/// Default maximum number of Gaussians of all moments together: 64 MB.
const MOST_MOVING_ROWS: usize = 2_000_000;

/// Positions that differ by less than this share of a Gaussian's middle axis are the same.
const SAME_PLACE: f32 = 0.1;
/// Sizes that differ by less than this share are the same.
const SAME_SIZE: f32 = 0.02;
/// Least scalar product of two quaternions that are the same: 1.6 degrees, three steps of a file's bytes.
const SAME_ROTATION: f32 = 0.9999;
/// Opacities and colours that differ by less are the same: a step of a file's bytes.
const SAME_LEVEL: f32 = 1.0 / 255.0;

/// The Gaussians of a dynamic scene.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Moments {
    /// The Gaussians that never change.
    pub(super) still: Vec<SplatRow>,
    /// The moments, seconds, with the other Gaussians as visible there.
    pub(super) moving: Vec<(f64, Vec<SplatRow>)>,
}

impl Moments {
    /// Returns the moments of a model over the time in which it changes, at the requested number or the clip's.
    /// `row` converts a Gaussian to its form in files. An error says why there are no moments.
    pub(super) fn of(
        model: &mut Model,
        span: &TimeSpan,
        asked: Option<usize>,
        row: impl Fn(&ActivatedGaussians, usize) -> SplatRow + Sync,
    ) -> Result<Self, String> {
        let of_clip = span.frames.unwrap_or(MOST_MOMENTS).min(MOST_MOMENTS);
        let mut count = asked.unwrap_or(of_clip);
        if count < 2 {
            return Err("one moment is shown".to_owned());
        }
        let first = activated(model, span.begin_seconds);
        let mut moves = vec![false; first.len()];
        for seconds in span.moments(count) {
            let now = activated(model, seconds);
            moves.par_iter_mut().enumerate().for_each(|(index, moves)| {
                *moves |= !is_same(&first, &now, index);
            });
        }
        let (moving, still): (Vec<usize>, Vec<usize>) =
            (0..first.len()).partition(|&index| moves[index]);
        if moving.is_empty() {
            return Err("nothing moves".to_owned());
        }
        let rows = |gaussians: &ActivatedGaussians, indices: &[usize]| -> Vec<SplatRow> {
            let rows = indices.par_iter().map(|&index| row(gaussians, index));
            rows.filter(|row| row.rgba[3] > 0).collect()
        };
        if asked.is_none() {
            // Many moving Gaussians are invisible at most moments.
            let seen: usize = span
                .moments(count)
                .into_iter()
                .map(|seconds| seen_of(&activated(model, seconds), &moving))
                .sum();
            count = fitting(count, seen);
        }
        if count < 2 {
            return Err(format!(
                "{} Gaussians move, which is too many for two moments or more",
                moving.len()
            ));
        }
        let still = rows(&first, &still);
        let mut moments = Vec::new();
        for seconds in span.moments(count) {
            let moving = rows(&activated(model, seconds), &moving);
            let together = (still.len() + moving.len()) as u64;
            if together > MOST_ROWS {
                return Err(format!(
                    "at {seconds:.2} s there are {together} Gaussians, viewers draw {MOST_ROWS} at most"
                ));
            }
            moments.push((seconds, moving));
        }
        Ok(Self {
            still,
            moving: moments,
        })
    }

    pub(super) fn files(&self) -> impl Iterator<Item = &[SplatRow]> {
        let moving = self.moving.iter().map(|(_, rows)| &rows[..]);
        [&self.still[..]].into_iter().chain(moving)
    }

    /// Returns the Gaussians of each file, mutable.
    pub(super) fn files_mut(&mut self) -> impl Iterator<Item = &mut Vec<SplatRow>> {
        let moving = self.moving.iter_mut().map(|(_, rows)| rows);
        [&mut self.still].into_iter().chain(moving)
    }

    /// Returns all Gaussians, mutable.
    pub(super) fn rows_mut(&mut self) -> impl Iterator<Item = &mut SplatRow> {
        self.files_mut().flatten()
    }
}

/// Returns the number of moments, at most `count`, that the limit allows, if all of them together show `seen`
/// Gaussians.
fn fitting(count: usize, seen: usize) -> usize {
    if seen <= MOST_MOVING_ROWS {
        return count;
    }
    count * MOST_MOVING_ROWS / seen
}

/// Returns the number of Gaussians that a viewer would draw.
fn seen_of(gaussians: &ActivatedGaussians, indices: &[usize]) -> usize {
    let is_seen = |&&index: &&usize| gaussians.opacities[index] >= 0.5 * SAME_LEVEL;
    indices.iter().filter(is_seen).count()
}

fn activated(model: &mut Model, seconds: f64) -> ActivatedGaussians {
    let mut gaussians = ActivatedGaussians::default();
    let at = Viewpoint::of_moment(seconds);
    model.activate(&at, &TemporalFeatures::default(), &mut gaussians);
    gaussians
}

/// Returns true if a viewer would show a Gaussian alike at two moments.
fn is_same(a: &ActivatedGaussians, b: &ActivatedGaussians, index: usize) -> bool {
    let [before, after] = [a, b].map(|all| all.opacities[index]);
    if before.max(after) < 0.5 * SAME_LEVEL {
        return true;
    }
    let [scales, others] = [a, b].map(|all| {
        let mut scales = all.scales[index];
        scales.sort_by(f32::total_cmp);
        scales
    });
    let [from, to] = [a, b].map(|all| glam::Vec3::from_array(all.positions[index]));
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    let is_close = |(a, b): (&f32, &f32)| (a - b).abs() < SAME_LEVEL / SH_C0;
    // In this form NaN is not the same.
    (before - after).abs() < SAME_LEVEL
        && from.distance(to) <= SAME_PLACE * scales[1]
        && (scales.iter().zip(others)).all(|(a, b)| (a - b).abs() <= SAME_SIZE * a)
        && dot(&a.rotations[index], &b.rotations[index]).abs() > SAME_ROTATION
        && (a.sh_constant[index].iter().zip(&b.sh_constant[index])).all(is_close)
}

#[cfg(test)]
mod tests {
    use omnilife_engine::gaussians::static_gaussians::{InitialGaussians, table};

    use super::*;

    /// Gaussians that pass along x, one unit a second, every other one of them.
    #[derive(Debug, Clone)]
    struct Passing;

    impl omnilife_engine::gaussians::parameterization::Parameterization for Passing {
        fn id(&self) -> &'static str {
            "passing"
        }

        fn activate(
            &mut self,
            table: &omnilife_engine::parameters::ParameterTable,
            at: &Viewpoint,
            features: &TemporalFeatures,
            first: usize,
            out: &mut ActivatedGaussians,
        ) {
            omnilife_engine::gaussians::static_gaussians::StaticGaussians
                .activate(table, at, features, first, out);
            for index in (0..table.len()).step_by(2) {
                out.positions[first + index][0] += at.seconds as f32;
                out.opacities[first + index] *= f32::from(at.seconds < 3.0);
            }
        }

        fn activate_backward(
            &mut self,
            _: &mut omnilife_engine::parameters::ParameterTable,
            _: &Viewpoint,
            _: &TemporalFeatures,
            _: usize,
            _: &mut ActivatedGaussians,
            _: &mut ActivatedGaussians,
        ) {
        }

        fn boxed(&self) -> Box<dyn omnilife_engine::gaussians::parameterization::Parameterization> {
            Box::new(self.clone())
        }
    }

    fn model(count: usize) -> Model {
        let positions = (0..count).map(|index| [0.0, index as f32, 0.0]).collect();
        let initial = InitialGaussians::isotropic(
            positions,
            &vec![0.1; count],
            vec![[0.5; 3]; count],
            vec![0.5; count],
        );
        Model::new(vec![omnilife_engine::model::Part::new(
            Passing,
            table(&initial, 0),
        )])
    }

    const SPAN: TimeSpan = TimeSpan {
        begin_seconds: 1.0,
        end_seconds: 4.0,
        frames: Some(4),
    };

    #[test]
    fn what_stands_still_is_there_once_and_what_moves_where_it_is_at_each_moment() {
        let found = Moments::of(&mut model(5), &SPAN, None, SplatRow::of);
        let Ok(found) = found else {
            panic!("{found:?}");
        };
        let still: Vec<f32> = found.still.iter().map(|row| row.position[1]).collect();
        assert_eq!(still, [1.0, 3.0]);
        let places = found.moving.iter().map(|(seconds, rows)| {
            let x: Vec<f32> = rows.iter().map(|row| row.position[0]).collect();
            (*seconds, x)
        });
        // From the third second on they are transparent.
        let expected = [
            (1.0, vec![1.0; 3]),
            (2.0, vec![2.0; 3]),
            (3.0, vec![]),
            (4.0, vec![]),
        ];
        assert!(places.eq(expected));
        assert_eq!(found.files().map(<[SplatRow]>::len).sum::<usize>(), 8);
    }

    #[test]
    fn one_moment_and_a_scene_that_stands_still_have_none() {
        let none = |count| Moments::of(&mut model(count), &SPAN, Some(1), SplatRow::of);
        assert_eq!(none(3), Err("one moment is shown".to_owned()));
        let mut still = Model::of_static(model(3).parts.remove(0).table);
        let found = Moments::of(&mut still, &SPAN, None, SplatRow::of);
        assert_eq!(found, Err("nothing moves".to_owned()));
    }

    #[test]
    fn there_are_fewer_moments_where_all_would_be_too_many_gaussians() {
        assert_eq!(fitting(60, 60 * 30_000), 60);
        assert_eq!(fitting(60, 60 * 100_000), 20);
        assert_eq!(fitting(60, 60 * 600_000), 3);
        assert!(fitting(60, 60 * 1_500_000) < 2, "none are left");
        // Both ends stay whatever their number.
        let ends = |count: usize| {
            let moments = SPAN.moments(count);
            [moments[0], moments[count - 1]]
        };
        assert_eq!([ends(2), ends(3), ends(20)], [[1.0, 4.0]; 3]);
    }
}
