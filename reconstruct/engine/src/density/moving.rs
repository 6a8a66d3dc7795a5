//! Density control of Gaussians that depend on time (PVG `scene/gaussian_model.py`).
//!
//! In addition to the rules in space, a Gaussian is cloned or split when the gradient of its peak time is
//! large: `|dL/dtau|`. The children of a split are displaced in time too: `tau'` is drawn from
//! `N(tau, beta)`, and they move by `vbar (tau' - tau)` to their parent's position at that time. In the
//! second half of densification a split has three children, with shorter lifespans.
//!
//! Departures: `|dL/dtau|` instead of the signed mean. Peak times stay within the clip and a tenth of it on
//! both sides. Gaussians too faint at all times of the clip are pruned, because they would never get a
//! gradient again.

use glam::Vec3;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

use crate::density::{
    Densified, DensifySettings, DensityContext, candidates, is_useful, remove, scatter_child,
    shrink, sizes::Sizes, strongest,
};
use crate::{
    gaussians::{
        parameterization::Viewpoint,
        periodic::TemporalParameters,
        static_gaussians::{OPACITY_LOGITS, POSITIONS, sigmoid},
        temporal::{LOG_LIFESPANS, PEAK_TIMES},
        temporal_gaussians::TemporalGaussians,
    },
    model::{Part, Statistics, dynamic_settings::TemporalDensity},
    parameters::ParameterTable,
};

/// Factor by which a split's children live shorter than their parent (PVG: 0.8 times 2 children).
pub(super) const LIFESPAN_SHRINK: f32 = 1.6;
/// Margin of peak times on both sides of the clip, as a share of it (PVG draws initial ones from 1.2 times
/// the clip).
pub(super) const PEAK_MARGIN: f32 = 0.1;

/// Inputs of density control for Gaussians that depend on time.
pub(super) struct MovingControl<'a> {
    pub(super) settings: &'a DensifySettings,
    /// Unit of sizes.
    pub(super) sizes: &'a Sizes,
    pub(super) temporal: TemporalGaussians,
    pub(super) scheduled: u64,
    pub(super) context: &'a DensityContext<'a>,
    /// Number of Gaussians that may be added.
    pub(super) room: usize,
}

/// Growth of a Gaussian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Growth {
    Clone,
    Split,
}

impl MovingControl<'_> {
    /// Clones, splits and prunes, and resets the statistics.
    pub(super) fn densify(&self, part: &mut Part, random: &mut Pcg64Mcg) -> Densified {
        let (mut clones, mut parents) = (Vec::new(), Vec::new());
        for (index, growth) in self.growing(part) {
            match growth {
                Growth::Clone => clones.push(index),
                Growth::Split => parents.push(index),
            }
        }
        let table = &mut part.table;
        table.append_copies(&clones);
        let shortens = self.shortens();
        let siblings = if shortens { 3 } else { 2 };
        let children: Vec<usize> = parents
            .iter()
            .flat_map(|&parent| std::iter::repeat_n(parent, siblings))
            .collect();
        let first_child = table.len();
        table.append_copies(&children);
        for child in first_child..table.len() {
            self.place_child(table, child, shortens, random);
        }
        self.temporal.time.keep_within_bounds(table);
        let pruned = remove(table, &parents, |table, index| {
            is_useful(table, index, self.settings, self.sizes, self.scheduled)
                && self.is_seen(table, index)
        });
        part.forget_statistics();
        Densified {
            cloned: clones.len(),
            split: parents.len(),
            pruned,
        }
    }

    /// Returns true if splits shorten lifespans at this iteration.
    fn shortens(&self) -> bool {
        self.context
            .temporal
            .is_some_and(|density| density.shortens(self.scheduled))
    }

    /// Returns the Gaussians that grow and their kind of growth, in order of their index.
    fn growing(&self, part: &Part) -> Vec<(usize, Growth)> {
        let Part {
            table, statistics, ..
        } = part;
        // A split into three adds two.
        let room = if self.shortens() {
            self.room / 2
        } else {
            self.room
        };
        let in_space = candidates(table, statistics, self.settings, self.context, room);
        let mut growth: Vec<Option<Growth>> = vec![None; table.len()];
        for &index in &in_space {
            let is_small = self
                .sizes
                .is_at_most(table, index, self.settings.clone_size);
            growth[index] = Some(if is_small {
                Growth::Clone
            } else {
                Growth::Split
            });
        }
        if let Some(density) = &self.context.temporal {
            let room = room - in_space.len();
            for index in self.restless(part, density, room) {
                let lifespan = self.temporal_parameters(table, index).lifespan;
                let in_time = if lifespan <= density.clone_lifespan_frames {
                    Growth::Clone
                } else {
                    Growth::Split
                };
                let grows = &mut growth[index];
                if *grows != Some(Growth::Split) {
                    *grows = Some(in_time);
                }
            }
        }
        let numbered = growth.into_iter().enumerate();
        numbered
            .filter_map(|(index, growth)| Some((index, growth?)))
            .collect()
    }

    /// Returns the Gaussians with a large gradient of their peak time.
    fn restless(&self, part: &Part, density: &TemporalDensity, room: usize) -> Vec<usize> {
        let Statistics {
            views,
            time_gradients,
            ..
        } = &part.statistics;
        let candidates = (0..part.table.len())
            .filter(|&index| views[index] > 0)
            .map(|index| {
                let mean = time_gradients[index] / views[index] as f32;
                (index, mean / density.gradient_threshold)
            })
            .filter(|&(_, excess)| excess >= 1.0);
        strongest(candidates.collect(), room)
    }

    fn temporal_parameters(&self, table: &ParameterTable, index: usize) -> TemporalParameters {
        // The position of a child hardly depends on the view.
        let view = &self.context.views[self.context.last_view].view;
        let look = self.temporal.look(&Viewpoint::of_image(view));
        self.temporal
            .time
            .temporal_table(table, look.observer)
            .temporal_parameters(index)
    }

    /// Moves a child in space and time.
    fn place_child(
        &self,
        table: &mut ParameterTable,
        child: usize,
        shortens: bool,
        random: &mut Pcg64Mcg,
    ) {
        let temporal_parameters = self.temporal_parameters(table, child);
        let is_large = !self
            .sizes
            .is_at_most(table, child, self.settings.clone_size);
        scatter_child(table, child, random);
        if is_large {
            shrink(table, child);
        }
        let Some(peaks) = table.position(PEAK_TIMES) else {
            return;
        };
        if temporal_parameters.lifespan.is_finite() {
            let normal: f32 = StandardNormal.sample(random);
            let half = (0.5 + PEAK_MARGIN) * self.temporal.clock.duration_frames;
            let peak = (temporal_parameters.peak + normal * temporal_parameters.lifespan)
                .clamp(-half, half);
            let mean = temporal_parameters.velocity
                * temporal_parameters.steadiness(self.temporal.time.cycle_frames);
            let moved = mean * (peak - temporal_parameters.peak);
            let position = &mut table.arrays[POSITIONS].values.as_chunks_mut::<3>().0[child];
            *position = (Vec3::from_array(*position) + moved).to_array();
            table.arrays[peaks].values[child] = peak;
        }
        if let Some(density) = self.context.temporal.filter(|_| shortens)
            && temporal_parameters.lifespan >= density.clone_lifespan_frames
            && let Some(lifespans) = table.position(LOG_LIFESPANS)
        {
            table.arrays[lifespans].values[child] -= LIFESPAN_SHRINK.ln();
        }
    }

    /// Returns true if a Gaussian is opaque enough at some time of the clip.
    fn is_seen(&self, table: &ParameterTable, index: usize) -> bool {
        let temporal_parameters = self.temporal_parameters(table, index);
        let half = 0.5 * self.temporal.clock.duration_frames;
        let distance = (temporal_parameters.peak.abs() - half).max(0.0);
        let opacity = sigmoid(table.arrays[OPACITY_LOGITS].values[index]);
        opacity * temporal_parameters.marginal(distance) >= self.settings.prune_opacity
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::{
        clock::Clock,
        density::{
            Threshold, densify,
            tests::{four, settings, views},
        },
        gaussians::{
            static_gaussians::InitialGaussians,
            temporal::{InitialTimes, LifespanRange, TimeModel, VelocityModel},
        },
    };

    const SHORTEN_FROM: u64 = 100;
    const DENSITY: TemporalDensity = TemporalDensity {
        gradient_threshold: 1.0,
        clone_lifespan_frames: 0.5,
        shorten_from_iteration: SHORTEN_FROM,
    };

    fn temporal() -> TemporalGaussians {
        TemporalGaussians {
            clock: Clock::new(0.0, 1.0, 40.0),
            time: TimeModel {
                cycle_frames: 10.0,
                lifespans: Some(LifespanRange {
                    least_frames: 0.25,
                    largest_frames: 1e6,
                }),
                velocity: VelocityModel::Free,
                least_marginal: 0.0,
            },
            down: [0.0, 1.0, 0.0],
            dynamic_below_staticness: 1.0,
        }
    }

    /// Returns one Gaussian per lifespan, each seen by two views, with sums of time gradients.
    fn moving(peaks: &[f32], lifespans: &[f32], time_gradients: &[f32]) -> Part {
        let len = peaks.len();
        let initial = InitialGaussians::isotropic(
            vec![[3.0, 0.0, 0.0]; len],
            &vec![0.01; len],
            vec![[0.5; 3]; len],
            vec![0.5; len],
        );
        let times = InitialTimes {
            peaks: peaks.into(),
            lifespans: lifespans.into(),
            velocities: vec![[0.0, 0.0, 1.0]; len],
        };
        let mut part = Part::new(temporal(), temporal().time.table(&initial, &times, 0));
        part.statistics = Statistics {
            sums: vec![0.0; len],
            views: vec![2; len],
            time_gradients: time_gradients.into(),
        };
        part
    }

    fn densified(part: &mut Part, scheduled: u64, room: usize) -> Densified {
        let (views, settings) = (views(), settings());
        assert_eq!(settings.gradient_threshold, Threshold::constant(1.0));
        let context = DensityContext {
            views: &views,
            last_view: 0,
            temporal: Some(DENSITY),
        };
        let control = MovingControl {
            settings: &settings,
            sizes: &Sizes::new(&settings, context.views),
            temporal: temporal(),
            scheduled,
            context: &context,
            room,
        };
        control.densify(part, &mut Pcg64Mcg::seed_from_u64(1))
    }

    fn column(part: &Part, name: &str) -> Vec<f32> {
        let array = part.table.position(name).expect("there");
        part.table.arrays[array].values.clone()
    }

    #[test]
    fn restless_gaussians_are_cloned_when_short_and_split_when_long() {
        let mut model = moving(&[0.0; 3], &[0.4, 4.0, 4.0], &[3.0, 3.0, 1.0]);
        let done = densified(&mut model, 1, 10);
        assert_eq!((done.cloned, done.split, done.pruned), (1, 1, 0));
        // The short one, the one without gradient, the copy, two children that live as long as their parent.
        let lifespans = column(&model, LOG_LIFESPANS);
        assert_eq!(lifespans.len(), 5);
        assert!((lifespans[3].exp() - 4.0).abs() < 1e-5);
        // Children lie at their parent's position at their own times.
        let peaks = column(&model, PEAK_TIMES);
        assert!(peaks[3] != peaks[4] && peaks[3] != 0.0);
        let steadiness = (-0.5_f32 * 0.4).exp();
        for child in [3, 4] {
            let position = model.table.row(POSITIONS, child);
            let expected = steadiness * peaks[child];
            assert!(
                (position[2] - expected).abs() < 0.05,
                "{position:?} {expected}"
            );
        }
        assert_eq!(model.statistics.time_gradients, [0.0; 5]);
    }

    #[test]
    fn later_splits_have_three_children_with_shorter_lives() {
        let mut model = moving(&[0.0], &[4.0], &[3.0]);
        assert_eq!(densified(&mut model.clone(), SHORTEN_FROM, 1).split, 0);
        let done = densified(&mut model, SHORTEN_FROM, 10);
        assert_eq!((done.split, model.table.len()), (1, 3));
        for lifespan in column(&model, LOG_LIFESPANS) {
            assert!((lifespan.exp() - 2.5).abs() < 1e-5);
        }
    }

    #[test]
    fn endless_lives_keep_their_children_near_the_clip_and_the_unseen_are_pruned() {
        let mut model = moving(&[0.0, 60.0, 22.0], &[1e6, 2.0, 2.0], &[3.0, 0.0, 0.0]);
        let done = densified(&mut model, 1, 10);
        // 40 frames after the clip's end is 20 lifespans; 2 frames is one.
        assert_eq!((done.split, done.pruned, model.table.len()), (1, 1, 3));
        for peak in column(&model, PEAK_TIMES) {
            assert!(peak.abs() <= 24.0, "{peak}");
        }
    }

    #[test]
    fn below_the_limit_gaussians_with_time_grow_first() {
        let mut model = four([4.0; 4], [2; 4]);
        model.parts.push(moving(&[0.0; 2], &[0.4; 2], &[3.0; 2]));
        let views = views();
        let context = DensityContext {
            views: &views,
            last_view: 0,
            temporal: Some(DENSITY),
        };
        let settings = DensifySettings {
            maximum_gaussians: 8,
            ..settings()
        };
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let done = densify(&mut model, &settings, 1, &context, &mut random);
        // There is room for two, but all six would grow.
        assert_eq!((done.cloned, done.split), (2, 0));
        assert_eq!(model.parts[1].table.len(), 4);
    }

    #[test]
    fn there_is_no_growth_without_room() {
        let mut model = moving(&[0.0; 2], &[0.4, 4.0], &[3.0, 4.0]);
        let done = densified(&mut model, 1, 0);
        assert_eq!((done.cloned, done.split, model.table.len()), (0, 0, 2));
        let mut model = moving(&[0.0; 2], &[0.4, 4.0], &[3.0, 4.0]);
        assert_eq!(densified(&mut model, 1, 1).split, 1);
    }
}
