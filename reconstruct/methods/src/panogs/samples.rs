//! First Gaussians of a run, from views with distances.

use omnilife_engine::gaussians::static_gaussians::InitialGaussians;
use omnilife_schemas::{points::PointCloud, records::Lift};

use super::{
    DEPTH_REFINEMENT, DEPTH_SCALE, POLE_THINNING, REDUNDANT_SAMPLES, depth_refinement, manifest,
};
use omnilife_training::{
    components::{Decision, DecisionLog, sky_shell},
    error::ReconstructError,
    scene::TrainingScene,
    seeds::{
        depth::{
            Agreement, DistanceView, LiftCounts, LiftSettings, ScaleFit, SourceView,
            SurfaceSamples, agreement,
            checks::{self, LEAST_DISAGREEMENT, differ},
            fit_scales, lift, scaled,
            sources::{self, Sources},
            tolerance,
        },
        points,
        sky::{OpenSky, SKY_SHARE},
    },
};

/// Minimum share of samples in two views for a choice between them.
const LEAST_SHARED: f64 = 0.05;
/// Maximum growth of thinned samples.
const LARGEST_GROWTH: f32 = 4.0;
/// Maximum number of places for finding directions without distances.
const MOST_PLACES: usize = 200_000;
/// Minimum number of views that see past a ghost.
const GHOST_VIEWS: u16 = 2;

/// First samples of a run.
#[derive(Debug)]
pub(super) struct Samples {
    /// The views, with corrected scales of their distances.
    pub(super) views: Vec<SourceView>,
    pub(super) gaussians: InitialGaussians,
    /// The view of each sample; samples of the sky have no view and are at the end.
    pub(super) view_of: Vec<u32>,
    /// Settings of their shapes.
    pub(super) shape: LiftSettings,
    /// Median radius of a sample, normalized units.
    pub(super) median_radius: f32,
    /// Warnings for readers of the scores.
    pub(super) warnings: Vec<String>,
    /// Gaussians of the sky.
    pub(super) sky: usize,
    /// Counts of the pixels by their use.
    pub(super) record: Lift,
    /// Median difference between views, with scale factors if they are used.
    disagreement: Option<f64>,
}

/// Said where no two views can be compared.
const NOT_MEASURED: &str = "no two views agree on a surface, so that their difference is not known";

/// Agreement of the views on their scales.
#[derive(Debug)]
pub(super) struct ScaleAgreement {
    /// Median difference between views without factors.
    pub(super) before: Option<f64>,
    /// Median difference with the factors.
    pub(super) disagreement: Option<f64>,
    /// The factor on the distances of each view.
    pub(super) factors: Vec<f64>,
}

/// The samples that stay.
#[derive(Debug)]
pub(super) struct SampleChoice {
    /// The samples of each view.
    pub(super) lifted: Vec<SurfaceSamples>,
    pub(super) shape: LiftSettings,
    /// Share of all samples that two or more views see past.
    pub(super) ghost_share: f64,
}

impl Samples {
    /// Lifts the distances of a scene's input views.
    pub(super) fn of(
        scene: &TrainingScene,
        plan: &mut DecisionLog<'_>,
    ) -> Result<Self, ReconstructError> {
        let Sources {
            mut views,
            origin,
            size,
        } = sources::of_scene(scene)?;
        checks::require_meaning(scene, &distance_views(&views))?;
        let mut warnings = vec![format!("distances are those of {origin}")];
        let agreed = agreed(scene, &mut views, plan, &mut warnings);
        refine(scene, &mut views, size, plan);
        let thins_poles = thins_poles(scene, &views, plan);
        let lifted: Vec<SurfaceSamples> = distance_views(&views)
            .iter()
            .enumerate()
            .map(|(number, view)| {
                let settings = LiftSettings {
                    thins_poles,
                    seed: plan.request.seed,
                    ..LiftSettings::OF_BEST_VIEWS
                };
                lift(view, number as u64, &settings)
            })
            .collect();
        if lifted.iter().all(SurfaceSamples::is_empty) {
            return Err(ReconstructError::Request {
                reason: format!(
                    "{}: no pixel of its input views has a usable distance",
                    scene.id
                ),
            });
        }
        let surfaces = some_places(&lifted);
        let chosen = chosen(&views, lifted, agreed.disagreement, plan, &mut warnings);
        let record = manifest::begun(scene, &origin, &agreed, &chosen);
        let mut samples = Self::joined(views, chosen, agreed.disagreement, warnings, record);
        samples.add_sky(scene, surfaces, plan);
        samples.thin(plan);
        samples.record = manifest::completed(samples.record.clone(), scene, &samples);
        Ok(samples)
    }

    fn joined(
        views: Vec<SourceView>,
        chosen: SampleChoice,
        disagreement: Option<f64>,
        mut warnings: Vec<String>,
        record: Lift,
    ) -> Self {
        let mut view_of = Vec::new();
        let mut all = SurfaceSamples::default();
        for (number, of_view) in chosen.lifted.into_iter().enumerate() {
            view_of.extend(std::iter::repeat_n(number as u32, of_view.len()));
            all.append(of_view);
        }
        warnings.push(summary(&all.counts, all.len()));
        let mut radii = all.radii;
        let middle = radii.len() / 2;
        let median_radius = *radii.select_nth_unstable_by(middle, f32::total_cmp).1;
        Self {
            views,
            gaussians: all.gaussians,
            view_of,
            shape: chosen.shape,
            median_radius,
            warnings,
            sky: 0,
            record,
            disagreement,
        }
    }

    /// Returns the views as inputs of the lift.
    pub(super) fn distance_views(&self) -> Vec<DistanceView<'_>> {
        distance_views(&self.views)
    }

    /// Decides on moving centres: by what it is worth also where distances are exact (docs/results/evidence.md, rules).
    pub(super) fn centre_decision(&self) -> Decision {
        let views = self.views.len();
        if views < 2 {
            return Decision::new(false, "one view does not tell a distance");
        }
        let found = match self.disagreement {
            Some(differ) => format!(
                "{views} views differ by {:.2} % where they see one surface; where they do not",
                100.0 * differ
            ),
            None => NOT_MEASURED.to_owned(),
        };
        let reason = format!("{found}, moving centres is worth 0.2 to 0.6 dB for 3 % of the time");
        Decision::new(true, reason)
    }

    /// Adds a shell where enough directions have no distance in any view. Samples keep their sizes, so it reaches the
    /// edge of every surface in every view.
    fn add_sky(
        &mut self,
        scene: &TrainingScene,
        surfaces: PointCloud<f32>,
        plan: &mut DecisionLog<'_>,
    ) {
        let with_points = TrainingScene {
            points: surfaces,
            ..scene.clone()
        };
        let room = self.gaussians.len() as u64;
        let sky = OpenSky::of(&with_points, room);
        let reason = format!(
            "{:.1} % of {} directions have no known distance (limit {:.0} %)",
            100.0 * sky.share(),
            sky.directions,
            100.0 * SKY_SHARE
        );
        let decision = Decision::new(sky.is_worth_a_shell(), reason).whatever_the_plan();
        if plan.decide(sky_shell::ID, decision) {
            let views = distance_views(&self.views);
            let shell = OpenSky::behind(&with_points, &views).shell_behind(&with_points, &views);
            self.sky = shell.len();
            self.gaussians.append(shell);
        }
    }

    /// Limits the number of Gaussians to the requested maximum: evenly spread, and larger for it.
    fn thin(&mut self, plan: &DecisionLog<'_>) {
        let Some(maximum) = plan.request.options.maximum_gaussians() else {
            return;
        };
        let all = self.gaussians.len();
        if all as u64 <= maximum {
            return;
        }
        let mut indices = points::thinned_indices(&points_of(&self.gaussians), maximum as usize);
        // Samples of the sky, which have no view, stay at the end.
        indices.sort_unstable();
        let growth = (all as f32 / maximum as f32).sqrt().min(LARGEST_GROWTH);
        self.gaussians = self.gaussians.selected(&indices);
        for scale in self.gaussians.scales.as_flattened_mut() {
            *scale *= growth;
        }
        let views = indices.iter().filter_map(|&index| self.view_of.get(index));
        self.view_of = views.copied().collect();
        self.warnings.push(format!(
            "{maximum} of {all} samples, evenly spread and {growth:.2} times as large"
        ));
    }
}

/// Returns places on the visible surfaces: enough of them to find the directions without any.
fn some_places(lifted: &[SurfaceSamples]) -> PointCloud<f32> {
    let all: usize = lifted.iter().map(SurfaceSamples::len).sum();
    let positions = lifted.iter().flat_map(|lifted| &lifted.gaussians.positions);
    let positions: Vec<[f32; 3]> = positions.step_by(all / MOST_PLACES + 1).copied().collect();
    PointCloud::of_colour(positions, [0; 3])
}

/// Returns the centres as points.
fn points_of(gaussians: &InitialGaussians) -> PointCloud<f32> {
    PointCloud::of_colour(gaussians.positions.clone(), [0; 3])
}

fn distance_views(views: &[SourceView]) -> Vec<DistanceView<'_>> {
    views.iter().map(SourceView::as_given).collect()
}

/// Applies factors to the views' distances where they disagree.
fn agreed(
    scene: &TrainingScene,
    views: &mut [SourceView],
    plan: &mut DecisionLog<'_>,
    warnings: &mut Vec<String>,
) -> ScaleAgreement {
    let fit: ScaleFit = fit_scales(&distance_views(views));
    let largest = fit
        .log_scales
        .iter()
        .copied()
        .fold(0.0, |most: f64, log| most.max(log.exp_m1().abs()));
    let reason = match fit.disagreement_before.zip(fit.disagreement_after) {
        Some((before, after)) => format!(
            "views differ by {:.2} % where they see one surface (limit {:.1} %), by {:.2} % with factors of up \
             to {:.2} %",
            100.0 * before,
            100.0 * LEAST_DISAGREEMENT,
            100.0 * after,
            100.0 * largest
        ),
        None => NOT_MEASURED.to_owned(),
    };
    if fit.disagreement_before.is_none() && views.len() > 1 {
        warnings.push(reason.clone());
    }
    let alone = (views.len() < 2).then_some("a second view");
    let decision = Decision::new(fit.disagreement_before.is_some_and(differ), reason).unless(alone);
    if fit.groups.len() > 1 {
        let frame = |&view: &usize| scene.input_views[view].frame.to_string();
        let groups = fit.groups.iter();
        let groups: Vec<String> = groups
            .map(|group| group.iter().map(frame).collect::<Vec<_>>().join(" "))
            .collect();
        warnings.push(format!(
            "the input views fall into {} groups without a common surface, each with a scale of its own: \
             frames {}",
            groups.len(),
            groups.join("; ")
        ));
    }
    if !plan.decide(DEPTH_SCALE, decision) {
        return ScaleAgreement {
            before: fit.disagreement_before,
            disagreement: fit.disagreement_before,
            factors: vec![1.0; views.len()],
        };
    }
    scaled(views, &fit);
    ScaleAgreement {
        before: fit.disagreement_before,
        disagreement: fit.disagreement_after,
        factors: fit.log_scales.iter().map(|log| log.exp()).collect(),
    }
}

/// Upsamples distances to the images' grids where those are finer.
fn refine(
    scene: &TrainingScene,
    views: &mut [SourceView],
    size: [usize; 2],
    plan: &mut DecisionLog<'_>,
) {
    let image = scene.camera.size();
    let reason = format!("distances are {} pixels wide, images {}", size[0], image[0]);
    let coarse = size[0] < image[0];
    let missing = (!coarse).then_some("images with more pixels than the distances");
    if plan.decide(
        DEPTH_REFINEMENT,
        Decision::new(coarse, reason).unless(missing),
    ) {
        for (view, image) in views.iter_mut().zip(&scene.input_views) {
            *view = depth_refinement::refined(image, view);
        }
    }
}

/// Decides on leaving out pixels near the poles.
fn thins_poles(scene: &TrainingScene, views: &[SourceView], plan: &mut DecisionLog<'_>) -> bool {
    let pixels: usize = views.iter().map(|view| view.distances.values.len()).sum();
    // The mean of cos(latitude) over the rows of a panorama is 2 / pi.
    let spared = (1.0 - std::f64::consts::FRAC_2_PI) * pixels as f64;
    let reason = format!(
        "rows of panoramas crowd towards the poles: {spared:.0} of {pixels} pixels show no more of the \
         sphere than the others do"
    );
    let missing = (!scene.camera.wraps()).then_some("panoramas");
    plan.decide(POLE_THINNING, Decision::new(true, reason).unless(missing))
}

/// Chooses the samples that stay, and shapes them.
fn chosen(
    views: &[SourceView],
    lifted: Vec<SurfaceSamples>,
    disagreement: Option<f64>,
    plan: &mut DecisionLog<'_>,
    warnings: &mut Vec<String>,
) -> SampleChoice {
    let distance_views = distance_views(views);
    let tolerance = tolerance(disagreement);
    let agreements: Vec<Vec<Agreement>> = lifted
        .iter()
        .enumerate()
        .map(|(own, lifted)| agreement(lifted, own, &distance_views, tolerance))
        .collect();
    let all = || agreements.iter().flatten();
    let count = |is: &dyn Fn(&Agreement) -> bool| all().filter(|found| is(found)).count();
    let total = all().count().max(1);
    let shared = count(&|found| found.support > 0) as f64 / total as f64;
    let finest = count(&|found| found.is_finest);
    let ghosts = count(&|found| found.free >= GHOST_VIEWS) as f64 / total as f64;
    warnings.push(format!(
        "{:.1} % of the samples stand where {GHOST_VIEWS} views or more see past them",
        100.0 * ghosts
    ));
    let reason = format!(
        "{:.0} % of {total} samples are seen by another view within {:.1} % (limit {:.0} %); {finest} are \
         the finest of their place",
        100.0 * shared,
        100.0 * tolerance,
        100.0 * LEAST_SHARED
    );
    let alone = (views.len() < 2).then_some("a second view");
    let decision = Decision::new(shared > LEAST_SHARED, reason).unless(alone);
    if plan.decide(REDUNDANT_SAMPLES, decision) {
        let kept = lifted.iter().zip(&agreements).map(|(lifted, found)| {
            let keep: Vec<bool> = found.iter().map(|found| found.is_finest).collect();
            lifted.retained(&keep)
        });
        return SampleChoice {
            lifted: kept.collect(),
            shape: LiftSettings::OF_BEST_VIEWS,
            ghost_share: ghosts,
        };
    }
    let shape = LiftSettings::OF_ALL_VIEWS;
    let shaped = lifted.into_iter().map(|lifted| lifted.shaped(&shape));
    SampleChoice {
        lifted: shaped.collect(),
        shape,
        ghost_share: ghosts,
    }
}

/// Returns a summary of the pixels' use, in a line.
fn summary(counts: &LiftCounts, kept: usize) -> String {
    format!(
        "{kept} samples of {} pixels: {} without a distance, {} masked, {} thinned near the poles, {} \
         between surfaces, {} finer elsewhere",
        counts.pixels,
        counts.unknown,
        counts.masked,
        counts.thinned,
        counts.flying,
        counts.pixels
            - counts.unknown
            - counts.masked
            - counts.thinned
            - counts.flying
            - kept as u64
    )
}
