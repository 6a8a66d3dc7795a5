//! Component: Gaussians start as oriented samples of distances, as many as the limit allows, and density control waits
//! for half of the schedule.
//!
//! Distances come from files where a scene has any, otherwise from sphere sweeps between input views. Gaussians at scene
//! points and of the sky stay where no view knows a surface. Masked pixels have no samples: seeds start on them, where
//! a method has these. Source: EDGS ([`dense`](crate::seeds::depth::dense)).
//!
//! The first densification takes the mean gradients of all steps before it: those of half of the schedule, where others
//! take those of one interval.

use std::f64::consts::PI;

use omnilife_engine::gaussians::static_gaussians::InitialGaussians;
use omnilife_schemas::points::PointCloud;
use rstar::{RTree, primitives::GeomWithData};

use crate::{
    baseline::OPACITY_RESET,
    components::{Component, Decision, Draft, Turn, static_table},
    evidence::SceneEvidence,
    seeds::{
        depth::{
            dense::{DenseSamples, DenseSurfaces},
            sources::{self, Origin},
        },
        points,
    },
};

/// Its name.
pub const ID: &str = "dense-start";

/// Dense start.
pub(crate) const COMPONENT: Component = Component {
    id: ID,
    title: "Dense start",
    description: "Gaussians start as flat samples of the surfaces that up to twelve input views know, of \
                  equal solid angles and as many as the limit allows, opaque by their confidence. Distances \
                  come from the scene's files, or from sphere sweeps between views. Scene points and sky stay \
                  where no view knows a surface. Density control starts at half of the schedule and ends at \
                  three quarters, without resets of opacities before. On request alone.",
    turn: Turn::AfterPoints,
    needs_pilot: |_, _| false,
    decide,
    apply,
};

/// Maximum number of views with samples, evenly from all input views.
const VIEWS: usize = 12;
/// Share of the room that Gaussians at points and of the sky keep at most, as its inverse.
const OTHERS_PART: usize = 2;
/// Quarters of the schedule between which density control works: sizes and colours settle before and after.
const DENSIFY_QUARTERS: [u64; 2] = [2, 3];

fn decide(_: &SceneEvidence, draft: &Draft<'_>) -> Decision {
    let origin = sources::origin(draft.scene);
    let missing = origin
        .is_none()
        .then_some("distances of files, or panoramas that stand apart: Gaussians start at points");
    let what = match origin {
        Some(Origin::Files) => "the scene has files of distances",
        Some(Origin::Sweep) | None => "sweeps between panoramas give distances",
    };
    Decision::on_request(&format!("its gain was measured on no scene; {what}")).unless(missing)
}

fn apply(draft: &mut Draft<'_>) {
    let sources = match sources::of_some(draft.scene, VIEWS) {
        Ok(sources) => sources,
        Err(error) => return draft.give_up(ID, &format!("{error}; Gaussians start at the points")),
    };
    let surfaces = DenseSurfaces::of(draft.scene, sources);
    if surfaces.known_share() == 0.0 {
        let why = "no pixel has a confirmed distance; Gaussians start at the points";
        return draft.give_up(ID, why);
    }
    let room = draft.room() as usize;
    let others = draft.points.len() + draft.fixed.len();
    let left_out = keep_uncovered(draft, &surfaces, room / OTHERS_PART);
    let kept = draft.points.len() + draft.fixed.len();
    let samples = surfaces.samples(room.saturating_sub(kept), draft.settings.exposure.as_ref());
    let count = samples.gaussians.len();
    let steradians = 4.0 * PI / samples.directions.max(1) as f64;
    let degrees = steradians.sqrt().to_degrees();
    place(draft, samples);
    let [begin, end] = delay_density(draft);
    let factors = surfaces
        .disagreement_before
        .map_or_else(String::new, |before| {
            format!(" (factors of each view, before: {:.2} %)", 100.0 * before)
        });
    let thinned = match left_out {
        0 => String::new(),
        _ => format!("; {left_out} uncovered ones are left out for half of the limit"),
    };
    let outcome = format!(
        "{count} samples, {degrees:.2} degrees across, of {} views by {}: {:.0} % of their pixels \
         have a distance, {:.2} % apart between views{factors}; {kept} of {others} Gaussians at points \
         and of the sky stay{thinned}; density control from iteration {begin} to {end}, without resets of \
         opacities before",
        surfaces.len(),
        surfaces.origin,
        100.0 * surfaces.known_share(),
        100.0 * surfaces.disagreement,
    );
    draft.report(ID, &outcome);
    if draft.is_used(OPACITY_RESET) {
        let outcome = format!("from iteration {begin} on");
        draft.plan.add_outcome(OPACITY_RESET, true, &outcome);
    }
}

/// Keeps the Gaussians where no view knows a surface, at most so many, evenly thinned; returns the number of those
/// that it thins out.
fn keep_uncovered(draft: &mut Draft<'_>, surfaces: &DenseSurfaces<'_>, most: usize) -> usize {
    let [of_points, of_fixed] =
        [&draft.points, &draft.fixed].map(|gaussians| uncovered(gaussians, surfaces));
    let found = of_points.len() + of_fixed.len();
    let all = found.max(most).max(1);
    let [of_points, of_fixed] = [(&draft.points, of_points), (&draft.fixed, of_fixed)]
        .map(|(gaussians, kept)| thinned(gaussians, &kept, kept.len() * most / all));
    let indices = of_points.iter().map(|&at| draft.point_indices[at]);
    draft.point_indices = indices.collect();
    draft.points = draft.points.selected(&of_points);
    draft.fixed = draft.fixed.selected(&of_fixed);
    found - of_points.len() - of_fixed.len()
}

/// Returns the indices of Gaussians that the surfaces do not cover.
fn uncovered(gaussians: &InitialGaussians, surfaces: &DenseSurfaces<'_>) -> Vec<usize> {
    let covered = surfaces.cover(&gaussians.positions);
    (0..gaussians.len()).filter(|&at| !covered[at]).collect()
}

/// Returns at most so many of some Gaussians, evenly spread, in their order.
fn thinned(gaussians: &InitialGaussians, kept: &[usize], most: usize) -> Vec<usize> {
    let positions = kept.iter().map(|&at| gaussians.positions[at]).collect();
    let cloud = PointCloud::of_colour(positions, [0; 3]);
    let chosen = points::thinned_indices(&cloud, most);
    let mut chosen: Vec<usize> = chosen.into_iter().map(|at| kept[at]).collect();
    chosen.sort_unstable();
    chosen
}

/// Adds the samples: without temporal parameters where the static table says so of the nearest scene point.
fn place(draft: &mut Draft<'_>, samples: DenseSamples) {
    let changes = changing(draft, &samples.gaussians.positions);
    let (changing, lasting) = points::partition(&samples.gaussians, &changes);
    draft.points.append(changing);
    draft.fixed.append(lasting);
}

/// Returns, for each position, true if Gaussians there have all of the method's parameters: all of them without
/// scene points.
fn changing(draft: &Draft<'_>, positions: &[[f32; 3]]) -> Vec<bool> {
    let pilot = draft.evidence.pilot.as_ref();
    let Some(pilot) = pilot.filter(|_| draft.is_used(static_table::ID)) else {
        return vec![true; positions.len()];
    };
    let scene = draft.scene.points.positions.iter();
    let scene = scene.zip(&pilot.changing.changes);
    let scene = scene.map(|(&position, &changes)| GeomWithData::new(position, changes));
    let tree = RTree::bulk_load(scene.collect());
    let nearest = |&position: &[f32; 3]| tree.nearest_neighbor(position);
    let of_nearest = positions.iter().map(nearest);
    of_nearest
        .map(|nearest| nearest.is_none_or(|point| point.data))
        .collect()
}

/// Delays density control; returns its first and last iterations.
fn delay_density(draft: &mut Draft<'_>) -> [u64; 2] {
    let iterations = u128::from(draft.settings.iterations);
    let [begin, end] =
        DENSIFY_QUARTERS.map(|quarters| (u128::from(quarters) * iterations / 4) as u64);
    let densify = &mut draft.settings.densify;
    densify.begin_iteration = densify.begin_iteration.max(begin);
    densify.end_iteration = densify.end_iteration.max(end);
    [densify.begin_iteration, densify.end_iteration]
}
