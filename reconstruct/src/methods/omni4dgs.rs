//! Omni4DGS: dynamic Gaussians on the sphere, told from static ones by masks.
//!
//! Source: "OmniLife360", section 4, Eqs. 1 to 12. The paper gives neither weights nor first values
//! nor rules of density; every such setting is named here with the reason for its value.

use crate::{
    baseline::{OPACITY_RESET, SKY_SHELL},
    components::{Components, pose_refinement},
    methods::{
        Method, MethodKind, PreparedGaussians,
        dynamic::{
            self, Beginning, CYCLE_FRAMES, Evidence, TEMPORAL_DENSITY, TEMPORAL_MOTION,
            TEMPORAL_OPACITY, TEMPORAL_SMOOTHING,
        },
    },
    options,
    request::{MethodRequest, PlanChoice},
};
use crate::{
    error::ReconstructError,
    evidence::{pilot::WarmUp, view_dependence::SH_DEGREE},
    request::BackendChoice,
    scene::TrainingScene,
    seeds::{
        masks::{MaskSeeds, SeedVelocity},
        points,
    },
};
use omnilife_engine::{
    clock::Clock,
    gaussians::{
        omni4dgs::{Decomposition, DirectionOrigin, VelocityForm},
        temporal::{TemporalFeatures, TimeModel, VelocityModel},
    },
    model::{
        dynamic_settings::{DynamicLoss, DynamicSettings, TemporalSmoothing, VelocityLoss},
        exposure::Exposure,
    },
    step::settings::TrainSettings,
};

/// Omni4DGS.
pub const METHOD: Method = Method {
    id: "omni4dgs",
    title: "Omni4DGS",
    source: "OmniLife360, section 4 (Omni4DGS)",
    description: "Gaussians that appear, move and vanish, with velocities of a radial and a \
                  tangential part; masks supervise the dynamic ones rendered alone; velocities \
                  are kept out of the static region and static Gaussians in their place. Dynamic \
                  Gaussians begin on masked pixels; with the component static-table, which is ours, \
                  scene points that do not change carry no temporal parameters. Readings of what \
                  the paper leaves open are named in the source.",
    components: &[
        TEMPORAL_OPACITY,
        TEMPORAL_MOTION,
        VELOCITY_DECOMPOSITION,
        DYNAMIC_MASK,
        MOTION_REGULARIZATION,
        VELOCITY_REGULARIZATION,
        STATIC_TABLE,
        TEMPORAL_DENSITY,
        SKY_SHELL,
        OPACITY_RESET,
    ],
    options: options::OF_GAUSSIANS,
    kind: MethodKind::Trained {
        prepare: |scene, request, backend| prepare(scene, request, backend)?.on(scene, backend),
    },
};

/// Component: velocities have a radial and a tangential part (Eq. 3).
pub(super) const VELOCITY_DECOMPOSITION: &str = "velocity-decomposition";
/// Component: masks supervise the dynamic Gaussians (Eqs. 4 to 7).
pub(super) const DYNAMIC_MASK: &str = "dynamic-mask";
/// Component: static Gaussians stay in their direction (Eqs. 10, 11).
pub(super) const MOTION_REGULARIZATION: &str = "motion-regularization";
/// Component: no velocities outside the masks (Eq. 9).
pub(super) const VELOCITY_REGULARIZATION: &str = "velocity-regularization";
/// Component: scene points at which nothing changes outside the masks become Gaussians without
/// temporal parameters. Not of the paper.
pub(super) const STATIC_TABLE: &str = "static-table";

/// Component: images are compared at one exposure. Not of the paper.
pub(super) const EXPOSURE_COMPENSATION: &str = "exposure-compensation";
/// Component: colours are spherical harmonics of [`SH_DEGREE`]. Not of the paper.
pub(super) const VIEW_DEPENDENT_COLOUR: &str = "view-dependent-colour";

/// Velocities (Eq. 3). `gamma`: weights "increase more smoothly in the equatorial region and decay
/// more rapidly in the polar regions", a flat top, so below 1. Literal: with projections and weights
/// nothing on the equator could approach. World: velocities that depend on who looks are none.
const DECOMPOSITION: Decomposition = Decomposition {
    gamma: 0.5,
    form: VelocityForm::Literal,
    origin: DirectionOrigin::World,
};
/// `theta_dgm`, as PVG tells static from dynamic on Waymo (`separate_scaling_t` 0.2 over the cycle's
/// 0.2), with the staticness `rho = beta / l`: the paper's `beta / tau` is singular at `tau = 0` and
/// changes with the origin of time.
const DYNAMIC_BELOW_STATICNESS: f32 = 1.0;
/// Staticness of seeds in masks: well below the threshold, but alive for some frames.
const SEED_STATICNESS: f32 = 0.4;
/// First lifespans elsewhere are the square root of this share of the clip (PVG on Waymo).
pub(super) const FIRST_LIFESPAN_SHARE: f32 = 0.1;
/// Staticness of scene points at first, at least.
const LEAST_FIRST_STATICNESS: f32 = 1.5 * DYNAMIC_BELOW_STATICNESS;
/// `lambda_dyn`: the dynamic region is small; more than the photometric loss pulls the dynamic
/// Gaussians away from the image that both make.
const DYNAMIC_WEIGHT: f32 = 0.1;
/// `lambda_d`, as `lambda` of 3DGS.
const DYNAMIC_SSIM_WEIGHT: f32 = 0.2;
/// `lambda_v`, as PVG on Waymo.
const VELOCITY_WEIGHT: f32 = 0.01;
/// `lambda_m`: at this weight a direction that changes by 0.1 rad per frame costs as much as an
/// error of 1e-4 in all pixels.
const MOTION_WEIGHT: f32 = 0.01;

/// What Omni4DGS and our extension of it do differently.
#[derive(Debug, Clone, Copy)]
pub(super) struct Variant {
    pub(super) id: &'static str,
    /// Least lifespan, frames; the dynamic methods' own where there is none.
    pub(super) least_lifespan_frames: Option<f32>,
    /// Temporal smoothing, a component then.
    pub(super) smoothing: Option<TemporalSmoothing>,
    /// First lifespans of scene points are the square root of this share of the clip.
    pub(super) first_lifespan_share: f32,
    /// First velocities of the seeds.
    pub(super) seed_velocity: SeedVelocity,
    /// Whether density control in time is a component.
    pub(super) splits_in_time: bool,
    /// Whether lifespans go as far in a short schedule as in a long one
    /// ([`dynamic::quicken_lifespans`]).
    pub(super) quickens_lifespans: bool,
    /// Whether gains of the views are compensated, a component then.
    pub(super) compensates_exposure: bool,
    /// Whether poses are refined, a component then.
    pub(super) refines_poses: bool,
    /// Whether colours depend on the direction where the scene's do, a component then.
    pub(super) colours_by_direction: bool,
    /// First opacity of scene points; that of static methods where there is none.
    pub(super) first_opacity: Option<f32>,
}

const PUBLISHED: Variant = Variant {
    id: METHOD.id,
    least_lifespan_frames: None,
    // The paper does not mention it.
    smoothing: None,
    first_lifespan_share: FIRST_LIFESPAN_SHARE,
    seed_velocity: SeedVelocity::None,
    splits_in_time: true,
    quickens_lifespans: false,
    compensates_exposure: false,
    colours_by_direction: false,
    refines_poses: false,
    first_opacity: None,
};

/// What is decided for a scene.
struct Decided {
    fades: bool,
    moves: bool,
    decomposes: bool,
    supervises: bool,
    steadies: bool,
    slows: bool,
    splits: bool,
    separates: bool,
    smooths: bool,
}

impl Decided {
    fn new(
        evidence: &Evidence,
        request: &MethodRequest,
        variant: &Variant,
        components: &mut Components<'_>,
    ) -> Self {
        let masks = evidence.reason.clone();
        let published = || (true, "as published".to_owned());
        let fades = components.decide(TEMPORAL_OPACITY, evidence.of_motion());
        let moves = components.decide(TEMPORAL_MOTION, evidence.of_motion());
        let without_motion = (!moves).then_some(TEMPORAL_MOTION);
        let without_masks = (!evidence.has_masks).then_some("masks that show something");
        let without_time = (!fades && !moves).then_some("time");
        let decomposes =
            components.decide_with(VELOCITY_DECOMPOSITION, without_motion, published());
        let missing = without_time.or(without_masks);
        let supervises = components.decide_with(DYNAMIC_MASK, missing, (true, masks.clone()));
        let steadies = components.decide_with(MOTION_REGULARIZATION, without_motion, published());
        let missing = without_motion.or(without_masks);
        let slows = components.decide_with(VELOCITY_REGULARIZATION, missing, (true, masks.clone()));
        let splits = variant.splits_in_time
            && components.decide_with(TEMPORAL_DENSITY, without_time, published());
        let smooths = variant.smoothing.is_some()
            && components.decide_with(
                TEMPORAL_SMOOTHING,
                without_motion,
                (true, "as PVG".to_owned()),
            );
        let missing = match request.plan {
            PlanChoice::Full => Some("leaving out parameters, which the plan full does not"),
            // Any point may move where nothing tells them apart.
            _ => (!supervises).then_some(DYNAMIC_MASK),
        };
        // What always is there is not missing at other times; what changes outside the masks, such as
        // shadows, needs to (docs/results/dynamic.md).
        let separates = components.decide_with(STATIC_TABLE, missing, (true, masks));
        Self {
            fades,
            moves,
            decomposes,
            supervises,
            steadies,
            slows,
            splits,
            separates,
            smooths,
        }
    }

    /// Settings of time for a scene of this extent, beside `settings`.
    fn dynamics(
        &self,
        scene: &TrainingScene,
        clock: Clock,
        variant: &Variant,
        settings: &TrainSettings,
    ) -> DynamicSettings {
        let velocity = match (self.moves, self.decomposes) {
            (false, _) => VelocityModel::None,
            (true, false) => VelocityModel::Free,
            (true, true) => VelocityModel::Decomposed(DECOMPOSITION),
        };
        let unit = dynamic::velocity_unit(crate::baseline::scene_extent(scene));
        DynamicSettings {
            clock,
            time: TimeModel {
                cycle_frames: CYCLE_FRAMES,
                lifespans: self
                    .fades
                    .then(|| dynamic::lifespans(variant.least_lifespan_frames)),
                velocity,
                least_marginal: 0.0,
            },
            down: dynamic::down(scene),
            dynamic_below_staticness: DYNAMIC_BELOW_STATICNESS,
            dynamic_loss: self.supervises.then_some(DynamicLoss {
                weight: DYNAMIC_WEIGHT,
                ssim_weight: DYNAMIC_SSIM_WEIGHT,
                begin_iteration: 0,
            }),
            velocity_loss: self.slows.then_some(VelocityLoss {
                weight: VELOCITY_WEIGHT,
                outside_masks: true,
            }),
            lifespan_weight: 0.0,
            features: TemporalFeatures {
                velocity_unit: self.slows.then_some(unit),
                lifespan: None,
            },
            motion_weight: if self.steadies { MOTION_WEIGHT } else { 0.0 },
            smoothing: variant.smoothing.filter(|_| self.smooths),
            density: self.splits.then(|| dynamic::temporal_density(settings)),
        }
    }
}

fn prepare(
    scene: &TrainingScene,
    request: &MethodRequest,
    backend: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    prepare_variant(&PUBLISHED, scene, request, backend)
}

/// The warm-up of the evidence, made where it was not needed before.
fn warm_up<'e>(
    evidence: &'e mut Evidence,
    scene: &TrainingScene,
    request: &MethodRequest,
) -> Result<&'e mut WarmUp, ReconstructError> {
    let made = match evidence.warm_up.take() {
        Some(made) => made,
        None => WarmUp::of(scene, request.seed)?,
    };
    Ok(evidence.warm_up.insert(made))
}

/// Decides by the drift of the exposure whether its gains are compensated; what changes is then looked
/// for without them.
fn exposure(
    evidence: &mut Evidence,
    scene: &TrainingScene,
    request: &MethodRequest,
    components: &mut Components<'_>,
) -> Result<Option<Exposure>, ReconstructError> {
    let warm_up = warm_up(evidence, scene, request)?;
    let Some(found) = warm_up.exposure().cloned() else {
        let missing = Some("enough scene points that are seen");
        components.decide_with(EXPOSURE_COMPENSATION, missing, (false, String::new()));
        return Ok(None);
    };
    let is_used = components.decide(EXPOSURE_COMPENSATION, (found.drifts(), found.text()));
    if is_used {
        warm_up.normalize();
    }
    Ok(is_used.then_some(found))
}

/// Degree of the spherical harmonics: on request, or by what directions predict of colours.
fn sh_degree(
    evidence: &mut Evidence,
    scene: &TrainingScene,
    request: &MethodRequest,
    components: &mut Components<'_>,
) -> Result<usize, ReconstructError> {
    if let Some(degree) = request.options.sh_degree() {
        let reason = format!("spherical harmonics of degree {degree} on request");
        components.record(VIEW_DEPENDENT_COLOUR, degree > 0, reason);
        return Ok(degree);
    }
    let found = warm_up(evidence, scene, request)?.view_dependence();
    let decision = (found.is_worth_harmonics(), found.text());
    let is_used = components.decide(VIEW_DEPENDENT_COLOUR, decision);
    Ok(if is_used { SH_DEGREE } else { 0 })
}

/// Decides components and first Gaussians of a variant.
pub(super) fn prepare_variant(
    variant: &Variant,
    scene: &TrainingScene,
    request: &MethodRequest,
    backend: BackendChoice,
) -> Result<PreparedGaussians, ReconstructError> {
    let clock = dynamic::check(variant.id, scene, backend)?;
    let mut settings = crate::baseline::settings(scene, request);
    dynamic::add_learning_rates(&mut settings, crate::baseline::scene_extent(scene));
    if variant.quickens_lifespans {
        dynamic::quicken_lifespans(&mut settings);
    }
    let mut evidence = Evidence::of(scene, request)?;
    let mut components = Components::new(request, Vec::new());
    let decided = Decided::new(&evidence, request, variant, &mut components);
    let seeds = if decided.supervises {
        let lifespan = SEED_STATICNESS * CYCLE_FRAMES;
        dynamic::seeds(scene, &settings, &clock, lifespan, variant.seed_velocity)
    } else {
        MaskSeeds::default()
    };
    if variant.compensates_exposure {
        settings.exposure = exposure(&mut evidence, scene, request, &mut components)?;
    }
    if variant.colours_by_direction {
        settings.rendering.sh_degree = sh_degree(&mut evidence, scene, request, &mut components)?;
    }
    if variant.refines_poses {
        // With what exposure was taken out of the views.
        let warm_up = warm_up(&mut evidence, scene, request)?;
        let found = warm_up.poses();
        if pose_refinement::decide(&found, &mut components) {
            pose_refinement::add(&mut settings, scene, &found);
            warm_up.correct_poses();
        }
    }
    let mut first =
        crate::baseline::first_gaussians(scene, &settings, request, seeds.gaussians.len());
    components.plan.extend(first.plan);
    let mut beginning = Beginning {
        fixed: first.shell,
        ..Beginning::default()
    };
    if let Some(opacity) = variant.first_opacity {
        first.points.opacities.fill(opacity);
    }
    if decided.separates {
        let found = warm_up(&mut evidence, scene, request)?.changing(&first.points.positions);
        components.add_reason(STATIC_TABLE, &found.text());
        let (changing, lasting) = points::partition(&first.points, &found.changes);
        beginning.fixed = points::join(lasting, beginning.fixed);
        first.points = changing;
    }
    if !first.points.is_empty() {
        // In a short clip too, points begin static: masks show what is dynamic.
        let least = LEAST_FIRST_STATICNESS * CYCLE_FRAMES;
        let lifespan = dynamic::first_lifespan(&clock, variant.first_lifespan_share).max(least);
        let times = dynamic::scattered_times(&clock, first.points.len(), lifespan, request.seed);
        beginning.add_moving(first.points, times);
    }
    beginning.add_moving(seeds.gaussians, seeds.times);
    settings.dynamics = Some(decided.dynamics(scene, clock, variant, &settings));
    dynamic::prepared(scene, request, settings, &beginning, components)
}
