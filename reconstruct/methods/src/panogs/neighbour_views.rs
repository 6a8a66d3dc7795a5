//! Training views of a shard: those near its own cameras (PanoGS, Section 3.5).
//!
//! A view that is `k` times as far from a surface as a sample's own view shows `k^2` such samples in one pixel,
//! and gives one value for all of them.

use glam::Vec3;
use omnilife_engine::camera::nearest::Projector;
use rayon::prelude::*;

use super::samples::Samples;
use omnilife_training::components::Decision;

/// Maximum distance of a near view from a sample, over that of the sample's own view.
const NEAR: f32 = 4.0;
/// Minimum share of a shard's samples that a training view of the shard is near and sees.
const LEAST_NEAR: f64 = 0.05;
/// Tolerance of visibility: the surface in a view may be nearer than a visible sample by this share.
const TOLERANCE: f32 = 0.05;
/// Minimum share of useless pairs of shard and view for leaving them out.
const LEAST_LEFT_OUT: f64 = 0.1;
/// Maximum number of examined samples of a shard.
const MOST_SAMPLES: usize = 4_000;

/// Near views of each shard.
#[derive(Debug)]
pub(super) struct NearViews {
    /// Numbers of input views; at least one for each shard.
    pub(super) views: Vec<Vec<u32>>,
    /// Number of pairs of shard and view.
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

    /// Returns the share of the pairs of shard and view that are not near.
    pub(super) fn share_left_out(&self) -> f64 {
        let near: usize = self.views.iter().map(Vec::len).sum();
        1.0 - near as f64 / self.pairs.max(1) as f64
    }

    /// Decides on leaving out useless pairs; `saved` are CPU seconds of a step.
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
        if self.share_left_out() > LEAST_LEFT_OUT {
            Decision::new(true, reason)
        } else {
            Decision::no_case(&reason)
        }
    }
}

/// Returns, by view, the share of a shard's samples that it is near and sees. Samples of the sky, which have no
/// view, count as visible to all.
fn near_shares(samples: &Samples, members: &[usize]) -> Vec<f64> {
    let views = samples.distance_views();
    let projectors: Vec<Projector> = views.iter().map(|view| Projector::new(view.view)).collect();
    let mut near = vec![0_usize; views.len()];
    let step = members.len().div_ceil(MOST_SAMPLES).max(1);
    let looked_at = || members.iter().step_by(step);
    for &member in looked_at() {
        let place = Vec3::from_array(samples.gaussians.positions[member]);
        let own = samples.view_of.get(member).map(|&view| view as usize);
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
