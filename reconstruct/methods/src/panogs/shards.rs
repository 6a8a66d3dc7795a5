//! Shards: neighbouring Gaussians train together, one shard after another from one render of all. So the memory
//! of a backward pass is that of one shard at a time.

use std::ops::Range;

use glam::Vec3;
use omnilife_engine::{
    camera::View,
    gaussians::{
        ActivatedGaussians,
        static_gaussians::{self, InitialGaussians},
    },
    render::{cpu::Renderer, raster::RasterGradient, settings::RenderSettings},
    step::{memory::StepMemory, shards::Shards},
};
use omnilife_schemas::elapsed::Stopwatch;

use super::{NEIGHBOUR_VIEWS, SHARDS, neighbour_views::NearViews, samples::Samples};
use omnilife_training::{
    components::{Decision, DecisionLog},
    process,
    request::BackendChoice,
    scene::TrainingScene,
};

/// Maximum share of the free memory for training: rendered and scored images need memory beside it.
const SHARE_OF_MEMORY: f64 = 0.8;
/// Maximum number of shards: with more, the render takes nearly all of the memory, and each shard walks its tiles
/// again.
const MOST_SHARDS: usize = 64;
/// Default number of shards on request.
const SHARDS_ON_REQUEST: usize = 8;
/// Gaussians of a trial step.
const TRIAL_GAUSSIANS: usize = 100_000;

/// Shards of Gaussians, and their training views.
#[derive(Debug)]
pub(super) struct Sharding {
    /// The Gaussians of each shard.
    pub(super) members: Vec<Vec<usize>>,
    /// The input views of each shard; `None` for all.
    pub(super) views: Option<Vec<Vec<u32>>>,
}

impl Sharding {
    /// Decides on shards, and on the training views of each; `None` where all train at once. `memory` is that of
    /// a step.
    pub(super) fn of(
        scene: &TrainingScene,
        samples: &Samples,
        memory: StepMemory,
        (rendering, backend): (RenderSettings, BackendChoice),
        plan: &mut DecisionLog<'_>,
    ) -> Option<Self> {
        let count = samples.gaussians.len();
        let bytes = |shards: usize| memory.bytes(count as u64, count.div_ceil(shards) as u64);
        let allowed = process::left_bytes().map(|left| (SHARE_OF_MEMORY * left as f64) as u64);
        let fits = |shards: usize| allowed.is_none_or(|allowed| bytes(shards) <= allowed);
        let asked = plan.request.options.shards();
        let needed = (1..MOST_SHARDS)
            .find(|&shards| fits(shards))
            .unwrap_or(MOST_SHARDS);
        let number = match (asked, needed) {
            (Some(asked), _) => asked,
            (None, 1) => SHARDS_ON_REQUEST,
            (None, needed) => needed,
        };
        let few = (count < number).then_some("as many Gaussians as shards");
        let all_at_once = format!(
            "training {count} Gaussians takes {:.2} GB, {}",
            gigabytes(bytes(1)),
            allowed.map_or(
                "the system does not say what is left".to_owned(),
                |allowed| format!("{:.2} GB may be taken", gigabytes(allowed))
            ),
        );
        let has_case = asked.map_or(needed > 1, |asked| asked > 1);
        if !has_case && !plan.request.names(SHARDS) {
            plan.decide(SHARDS, Decision::no_case(&all_at_once).unless(few));
            plan.decide(NEIGHBOUR_VIEWS, Decision::without("shards"));
            return None;
        }
        let mut trial = Trial::of(scene, samples, number.min(count.max(1)), rendering);
        let reason = format!(
            "{all_at_once}; {number} shards take {:.2} GB less and about {:.2} CPU seconds a step more",
            gigabytes(bytes(1) - bytes(number)),
            trial.seconds_of_shards()
        );
        let decision = match backend {
            BackendChoice::Cpu => Decision::new(has_case, reason),
            BackendChoice::Gpu => Decision::new(
                asked.is_some_and(|asked| asked > 1),
                "a step on a GPU takes all Gaussians at once: shards save no memory there",
            ),
        };
        let is_used = plan.decide(SHARDS, decision.unless(few));
        if !is_used {
            plan.decide(NEIGHBOUR_VIEWS, Decision::without("shards"));
            return None;
        }
        let members = split(&samples.gaussians.positions, number);
        let near = NearViews::of(samples, &members);
        let saved = trial.seconds_of_backward * near.share_left_out();
        let is_used = plan.decide(NEIGHBOUR_VIEWS, near.decision(saved));
        Some(Self {
            members,
            views: is_used.then_some(near.views),
        })
    }

    /// Returns the number of Gaussians of the largest shard.
    pub(super) fn largest(&self) -> usize {
        self.members.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Returns the settings for training.
    pub(super) fn settings(self) -> Shards {
        Shards {
            gaussians: self
                .members
                .iter()
                .map(|members| members.len() as u64)
                .collect(),
            views: self.views,
        }
    }
}

fn gigabytes(bytes: u64) -> f64 {
    bytes as f64 / 1e9
}

/// Cost of the backward pass of a step, tried with some of the Gaussians on the first view.
#[derive(Debug, Default)]
struct Trial {
    /// CPU seconds, all Gaussians at once.
    seconds_whole: f64,
    /// CPU seconds, shard after shard.
    seconds_of_backward: f64,
}

impl Trial {
    fn of(
        scene: &TrainingScene,
        samples: &Samples,
        shards: usize,
        rendering: RenderSettings,
    ) -> Self {
        let (count, Some(view)) = (samples.gaussians.len(), scene.input_views.first()) else {
            return Self::default();
        };
        let step = count.div_ceil(TRIAL_GAUSSIANS).max(1);
        let some: Vec<usize> = (0..count).step_by(step).collect();
        let some = samples.gaussians.selected(&some);
        let members = split(&some.positions, shards);
        let gaussians = some.selected(&members.concat());
        let ranges = ranges(&members);
        let mut least = Self {
            seconds_whole: f64::INFINITY,
            seconds_of_backward: f64::INFINITY,
        };
        let all = 0..gaussians.len();
        let mut drawing = Drawing::of(&view.view, &gaussians, rendering);
        // The first round fills buffers.
        for _ in 0..2 {
            let whole = drawing.seconds_of_backward(std::slice::from_ref(&all));
            let in_shards = drawing.seconds_of_backward(&ranges);
            least.seconds_whole = least.seconds_whole.min(whole);
            least.seconds_of_backward = least.seconds_of_backward.min(in_shards);
        }
        let scale = count as f64 / gaussians.len().max(1) as f64;
        Self {
            seconds_whole: scale * least.seconds_whole,
            seconds_of_backward: scale * least.seconds_of_backward,
        }
    }

    /// Returns the CPU seconds that shards add to a step.
    fn seconds_of_shards(&mut self) -> f64 {
        (self.seconds_of_backward - self.seconds_whole).max(0.0)
    }
}

/// A rendered view.
struct Drawing {
    renderer: Renderer,
    view: View,
    activated: ActivatedGaussians,
    by_image: Vec<f32>,
    gradient: ActivatedGaussians,
}

impl Drawing {
    fn of(view: &View, gaussians: &InitialGaussians, rendering: RenderSettings) -> Self {
        let mut activated = ActivatedGaussians::default();
        static_gaussians::activate(&static_gaussians::table(gaussians, 0), &mut activated);
        let mut renderer = Renderer::new(rendering);
        let by_image = vec![1e-6; renderer.forward(view, &activated).colour.len()];
        Self {
            renderer,
            view: *view,
            activated,
            by_image,
            gradient: ActivatedGaussians::default(),
        }
    }

    fn seconds_of_backward(&mut self, ranges: &[Range<usize>]) -> f64 {
        let upstream = RasterGradient::new(&self.by_image, &[]);
        let begun = Stopwatch::of_own_process();
        for range in ranges {
            self.renderer.backward_of(
                range.clone(),
                &self.view,
                &self.activated,
                &upstream,
                &mut self.gradient,
            );
        }
        let took = begun.elapsed();
        took.cpu_seconds.unwrap_or(took.wall_seconds)
    }
}

/// Returns the range of each shard's members when the shards are stored one after another.
fn ranges(members: &[Vec<usize>]) -> Vec<Range<usize>> {
    let mut first = 0;
    let lengths = members.iter().map(Vec::len);
    lengths
        .map(|len| {
            let range = first..first + len;
            first = range.end;
            range
        })
        .collect()
}

/// Cuts places into `count` shards of nearly equal size: at a plane across the longest side of the box around
/// them, and the two halves again.
pub(super) fn split(positions: &[[f32; 3]], count: usize) -> Vec<Vec<usize>> {
    let mut shards = Vec::with_capacity(count);
    let mut members: Vec<usize> = (0..positions.len()).collect();
    cut(positions, &mut members, count.max(1), &mut shards);
    shards
}

fn cut(positions: &[[f32; 3]], members: &mut [usize], count: usize, shards: &mut Vec<Vec<usize>>) {
    if count == 1 {
        let mut shard = members.to_vec();
        shard.sort_unstable();
        shards.push(shard);
        return;
    }
    let places = || {
        members
            .iter()
            .map(|&member| Vec3::from_array(positions[member]))
    };
    let least = places().fold(Vec3::INFINITY, Vec3::min);
    let size = places().fold(Vec3::NEG_INFINITY, Vec3::max) - least;
    let axis = size.max_position();
    let left = count / 2;
    let middle = (members.len() * left).div_ceil(count).min(members.len());
    if middle < members.len() {
        // Ties by number: the same on every machine.
        members.select_nth_unstable_by(middle, |&a, &b| {
            let along = |member: usize| positions[member][axis];
            along(a).total_cmp(&along(b)).then(a.cmp(&b))
        });
    }
    let (before, behind) = members.split_at_mut(middle);
    cut(positions, before, left, shards);
    cut(positions, behind, count - left, shards);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_of_equal_size_and_lie_apart() {
        // A line of twice as many places as a shard has along x, in two rows.
        let positions: Vec<[f32; 3]> = (0..36)
            .map(|place| [(place * 7 % 18) as f32, (place % 2) as f32, 0.0])
            .collect();
        let shards = split(&positions, 6);
        assert!(shards.iter().all(|shard| shard.len() == 6));
        let mut all = shards.concat();
        all.sort_unstable();
        assert_eq!(all, (0..36).collect::<Vec<_>>());
        let mut farthest = f32::NEG_INFINITY;
        for shard in &shards {
            let along = || shard.iter().map(|&member| positions[member][0]);
            assert!(along().fold(f32::INFINITY, f32::min) >= farthest);
            farthest = along().fold(farthest, f32::max);
        }
        assert_eq!(split(&positions[..3], 1), [vec![0, 1, 2]]);
    }
}
