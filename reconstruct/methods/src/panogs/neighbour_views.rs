//! The views that a shard learns from: those near its own cameras (PanoGS, Section 3.5).
//!
//! A pixel of a view that is `k` times as far from a surface as the view that a sample is of shows `k^2` such
//! samples, and says one thing of all of them.

use glam::Vec3;
use omnilife_engine::camera::nearest::Projector;
use rayon::prelude::*;

use super::samples::Samples;
use omnilife_training::components::Decision;

/// A view is near a sample where it is at most this many times as far from it as the sample's own.
const NEAR: f32 = 4.0;
/// Share of a shard's samples that a view has to be near, and to see, to teach the shard.
const LEAST_NEAR: f64 = 0.05;
/// What a view shows may be nearer than a sample by this share where it sees the sample.
const TOLERANCE: f32 = 0.05;
/// Share of the pairs of shard and view that must be of no use for them to be left out.
const LEAST_LEFT_OUT: f64 = 0.1;
/// Samples of a shard that are looked at, at most.
const MOST_SAMPLES: usize = 4_000;

/// By shard, the views near it.
#[derive(Debug)]
pub(super) struct NearViews {
    /// Numbers of input views; one of each shard at least.
    pub(super) views: Vec<Vec<u32>>,
    /// Pairs of shard and view that there are.
    pairs: usize,
}

impl NearViews {
    pub(super) fn of(samples: &Samples, members: &[Vec<usize>]) -> Self {
        let of_shard = |members: &Vec<usize>| {
            let shares = near_shares(samples, members);
            let best =
                (0..shares.len()).max_by(|&a, &b| shares[a].total_cmp(&shares[b]).then(b.cmp(&a)));
            let is_near = |view: &usize| shares[*view] >= LEAST_NEAR || Some(*view) == best;
            let near = (0..shares.len()).filter(is_near);
            near.map(|view| view as u32).collect()
        };
        Self {
            views: members.par_iter().map(of_shard).collect(),
            pairs: members.len() * samples.views.len(),
        }
    }

    /// Share of the pairs of shard and view that are not near.
    pub(super) fn share_left_out(&self) -> f64 {
        let near: usize = self.views.iter().map(Vec::len).sum();
        1.0 - near as f64 / self.pairs.max(1) as f64
    }

    /// Used where enough pairs are of no use; `saved` are CPU seconds of a step.
    pub(super) fn decision(&self, saved: f64) -> Decision {
        let reason = format!(
            "{:.0} % of {} pairs of shard and view are not near (the view sees less than {:.0} % of the shard \
             from at most {NEAR} times its own distance; limit {:.0} %); without them a step takes about {saved:.2} \
             CPU seconds less",
            100.0 * self.share_left_out(),
            self.pairs,
            100.0 * LEAST_NEAR,
            100.0 * LEAST_LEFT_OUT
        );
        Decision::new(self.share_left_out() > LEAST_LEFT_OUT, reason)
    }
}

/// By view, the share of a shard's samples that it is near and sees. The sky's, which no view knows, count
/// as seen by all.
fn near_shares(samples: &Samples, members: &[usize]) -> Vec<f64> {
    let views = samples.distance_views();
    let projectors: Vec<Projector> = views.iter().map(|view| Projector::new(view.view)).collect();
    let mut near = vec![0_usize; views.len()];
    let step = members.len().div_ceil(MOST_SAMPLES).max(1);
    let looked_at = || members.iter().step_by(step);
    for &member in looked_at() {
        let place = Vec3::from_array(samples.gaussians.positions[member]);
        let own = samples.view_of.get(member).map(|&view| usize::from(view));
        let own = own.map(|own| (own, place.distance(views[own].view.centre)));
        for (number, (view, projector)) in views.iter().zip(&projectors).enumerate() {
            let is_near = own.is_none_or(|(own, own_distance)| {
                let sees = |(pixel, distance): (usize, f32)| {
                    let shown = view.distances.values[pixel];
                    distance <= NEAR * own_distance && shown >= (1.0 - TOLERANCE) * distance
                };
                number == own || projector.pixel(place).is_some_and(sees)
            });
            near[number] += usize::from(is_near);
        }
    }
    let total = looked_at().count().max(1);
    near.into_iter()
        .map(|near| near as f64 / total as f64)
        .collect()
}
