//! What static Gaussians cannot explain: whether anything moves in a scene without masks, and at
//! which points something changes outside of them, such as the shadow of what moves.
//!
//! After a short static warm-up input views are compared with their renders at the images of the
//! same scene points, those that the warm-up's depth shows to be visible and no mask covers. What a
//! static scene leaves unexplained at a point - too little texture, a wrong colour - is the same in
//! all views: only the deviation `d` of a residual from its point's median counts, channel by
//! channel. Photometric noise is the median of `|d|`; what passes in front of a point, or shades it,
//! deviates by many times as much, in a few views.

use glam::Vec3;
use omnilife_schemas::progress::Silent;
use rayon::prelude::*;

use crate::{
    camera::{View, erp},
    error::ReconstructError,
    exposure::Exposure,
    gaussians::{InstantGaussians, static_gaussians},
    initialize,
    methods::{MethodRequest, odgs},
    render::Renderer,
    scene::{SceneView, TrainingScene},
    train::Session,
};

/// Iterations of the warm-up: enough for colours and coarse shapes.
pub const WARM_UP_ITERATIONS: u64 = 150;
/// Gaussians of the warm-up, at most.
const WARM_UP_GAUSSIANS: u64 = 12_000;
/// Views of the warm-up are no wider than they have to be to show what moves, pixels.
const WARM_UP_WIDTH: u32 = 256;
/// Points and views that are looked at, evenly from all.
const POINTS: usize = 4_000;
const VIEWS: usize = 30;
/// A point is visible when it is no farther than this over the rendered depth,
const DEPTH_SLACK: f32 = 1.05;
/// where at least this much of the pixel is covered.
const LEAST_OPACITY: f32 = 0.5;
/// Points seen by fewer views have no median to speak of.
const LEAST_VIEWS: usize = 6;
/// A deviation is transient above this many times the noise, and above this in grey levels of 1.
const NOISE_FACTOR: f32 = 8.0;
const LEAST_DEVIATION: f32 = 0.1;
/// Views in which a point deviates, from which on it changes: one alone may be an edge.
const LEAST_DEVIATING_VIEWS: usize = 2;
/// Share of transient samples from which a scene is taken to move: three times what a clip in which
/// nothing moves has, a third of what two people who walk through it make (docs/results/dynamic.md).
const TRANSIENT_SHARE: f64 = 0.0004;
/// Half of the window, in turns, over which a sample is averaged to tell whether anything moves: what
/// moves is wrong all over, an edge that the warm-up blurs is wrong on both sides, with both signs.
const MOTION_REACH_TURNS: f32 = 4.0 / 256.0;
/// Standard deviation of a normal distribution over its median absolute deviation.
const PER_MEDIAN: f32 = 1.4826;

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MotionEvidence {
    /// Points in views that were compared, channel by channel.
    pub samples: usize,
    /// Photometric noise: standard deviation, grey levels in `[0, 1]`.
    pub noise: f32,
    /// Share of the samples that deviate by far more.
    pub transient_share: f64,
}

impl MotionEvidence {
    /// Whether something moves. Without samples nothing is known, and it may.
    pub fn moves(&self) -> bool {
        self.samples == 0 || self.transient_share >= TRANSIENT_SHARE
    }

    /// Deviation from which a sample is transient.
    fn limit(&self) -> f32 {
        (NOISE_FACTOR * self.noise).max(LEAST_DEVIATION)
    }

    /// In words.
    pub fn text(&self) -> String {
        if self.samples == 0 {
            return "no scene point is seen by enough views to tell whether something moves"
                .to_owned();
        }
        format!(
            "after {WARM_UP_ITERATIONS} static iterations {:.2} % of {} samples at scene points \
             deviate from their point's median by {NOISE_FACTOR} times the noise of {:.4} or more \
             (limit {:.2} %)",
            100.0 * self.transient_share,
            self.samples,
            self.noise,
            100.0 * TRANSIENT_SHARE
        )
    }
}

/// Input views beside the renders of a short static training.
#[derive(Debug)]
pub struct WarmUp {
    /// The scene at the size that it was looked at.
    scene: TrainingScene,
    views: Vec<Compared>,
    exposure: Option<Exposure>,
    is_normalized: bool,
}

impl WarmUp {
    /// Trains static Gaussians for a short while and renders views.
    ///
    /// # Errors
    /// When the training diverges.
    pub fn of(scene: &TrainingScene, seed: u64) -> Result<Self, ReconstructError> {
        let scene = scene.reduced(WARM_UP_WIDTH);
        let request = MethodRequest {
            maximum_gaussians: Some(WARM_UP_GAUSSIANS),
            trace_every: Some(WARM_UP_ITERATIONS),
            ..MethodRequest::new(WARM_UP_ITERATIONS, seed)
        };
        let session = Session::without_files(&Silent);
        let mut gaussians = InstantGaussians::default();
        let mut outcome = odgs::METHOD.train(&scene, &request, &session)?;
        static_gaussians::instantiate(&outcome.trained.stepper.model()?.table, &mut gaussians);
        let mut renderer = Renderer::new(outcome.settings.rendering);
        drop(outcome);
        let all = scene.input_views.len();
        let views = (0..all.min(VIEWS))
            .map(|step| {
                let number = step * all / all.min(VIEWS);
                let view = &scene.input_views[number];
                Compared::new(number, view, &mut gaussians, &mut renderer)
            })
            .collect();
        let mut warm_up = Self {
            scene,
            views,
            exposure: None,
            is_normalized: false,
        };
        warm_up.exposure = warm_up.estimated_exposure();
        Ok(warm_up)
    }

    /// Whether anything moves, by some of the scene's points.
    pub fn motion(&self) -> MotionEvidence {
        let points = initialize::thinned(&self.scene.points, POINTS).positions;
        let reach = (self.scene.camera.width as f32 * MOTION_REACH_TURNS).round() as usize;
        transients(&self.residuals(&points, reach.max(1)))
    }

    /// Tells at which points something changes outside the masks.
    pub fn changing(&self, points: &[[f32; 3]]) -> ChangingPoints {
        let residuals = self.residuals(points, 1);
        let evidence = transients(&residuals);
        let limit = evidence.limit();
        let changes = residuals
            .chunks_exact(3)
            .map(|channels| {
                channels.iter().any(|residuals| {
                    let deviating = deviations(residuals).filter(|deviation| *deviation >= limit);
                    deviating.count() >= LEAST_DEVIATING_VIEWS
                })
            })
            .collect();
        ChangingPoints { evidence, changes }
    }

    /// How bright the views are; `None` where too few points are seen.
    pub fn exposure(&self) -> Option<&Exposure> {
        self.exposure.as_ref()
    }

    fn estimated_exposure(&self) -> Option<Exposure> {
        let points = initialize::thinned(&self.scene.points, POINTS).positions;
        let views: Vec<(f64, Vec<[[f32; 3]; 2]>)> = self
            .views
            .iter()
            .map(|compared| {
                let pairs = self.samples(compared, &points, 1).into_iter().flatten();
                let pairs = pairs.map(|sample| [sample.shown, sample.rendered()]);
                (self.view(compared).time_seconds, pairs.collect())
            })
            .collect();
        Exposure::estimate(&views)
    }

    /// Takes the gains out of what the views show, once.
    pub fn normalize(&mut self) {
        if let Some(exposure) = self.exposure.as_ref().filter(|_| !self.is_normalized) {
            for compared in &mut self.views {
                let view = &self.scene.input_views[compared.number].view;
                compared.normalize(exposure, view.time_seconds);
            }
            self.is_normalized = true;
        }
    }

    fn view(&self, compared: &Compared) -> &View {
        &self.scene.input_views[compared.number].view
    }

    fn samples(
        &self,
        compared: &Compared,
        points: &[[f32; 3]],
        reach: usize,
    ) -> Vec<Option<Sample>> {
        let view = self.view(compared);
        points
            .par_iter()
            .map(|&point| compared.sample(&self.scene, view, Vec3::from_array(point), reach))
            .collect()
    }

    /// Residuals of the views in which a point is seen: one series per point and channel.
    fn residuals(&self, points: &[[f32; 3]], reach: usize) -> Vec<Vec<f32>> {
        let mut residuals: Vec<Vec<f32>> = vec![Vec::new(); 3 * points.len()];
        for compared in &self.views {
            let samples = self.samples(compared, points, reach).into_iter();
            for (point, sample) in samples.enumerate() {
                for (channel, residual) in sample.iter().flat_map(|s| s.residual).enumerate() {
                    residuals[3 * point + channel].push(residual);
                }
            }
        }
        residuals
    }
}

/// What a view shows at a point: means over a window.
#[derive(Debug, Clone, Copy)]
struct Sample {
    shown: [f32; 3],
    /// Shown minus rendered.
    residual: [f32; 3],
}

impl Sample {
    fn rendered(&self) -> [f32; 3] {
        [0, 1, 2].map(|channel| self.shown[channel] - self.residual[channel])
    }
}

/// Points at which something changes, and how that was found out.
#[derive(Debug, Clone, PartialEq)]
pub struct ChangingPoints {
    /// What is known of all of them.
    pub evidence: MotionEvidence,
    /// Per point, whether it changes. Points that too few views see do not.
    pub changes: Vec<bool>,
}

impl ChangingPoints {
    /// In words.
    pub fn text(&self) -> String {
        let changing = self.changes.iter().filter(|&&changes| changes).count();
        format!(
            "{changing} of {} scene points change outside the masks: after {WARM_UP_ITERATIONS} \
             static iterations their residuals deviate in {LEAST_DEVIATING_VIEWS} views or more \
             from the point's median by {NOISE_FACTOR} times the noise of {:.4}, or by \
             {LEAST_DEVIATION}, whichever is more",
            self.changes.len(),
            self.evidence.noise
        )
    }
}

/// A view beside its render.
#[derive(Debug)]
struct Compared {
    /// Its number among the input views.
    number: usize,
    width: usize,
    height: usize,
    /// The image.
    shown: Vec<[f32; 3]>,
    /// Image minus render; not a number where a mask says that something else is seen.
    difference: Vec<[f32; 3]>,
    /// Radial depth, infinite where little is rendered.
    depth: Vec<f32>,
}

impl Compared {
    fn new(
        number: usize,
        view: &SceneView,
        gaussians: &mut InstantGaussians,
        renderer: &mut Renderer,
    ) -> Self {
        let centre = view.view.centre;
        gaussians.feature_count = 1;
        gaussians.features = gaussians
            .positions
            .iter()
            .map(|&position| (Vec3::from_array(position) - centre).length())
            .collect();
        let raster = renderer.forward(&view.view, gaussians);
        let (mut image, mut mask) = (Vec::new(), Vec::new());
        view.write_image(&mut image);
        view.write_mask(&mut mask);
        let pixels = image
            .as_chunks::<3>()
            .0
            .iter()
            .zip(raster.colour.as_chunks::<3>().0);
        Self {
            number,
            shown: image.as_chunks::<3>().0.to_vec(),
            width: raster.width,
            height: raster.height,
            difference: pixels
                .zip(&mask)
                .map(|((truth, render), &masked)| {
                    let hole = if masked > 0.0 { f32::NAN } else { 0.0 };
                    [0, 1, 2].map(|channel| truth[channel] - render[channel] + hole)
                })
                .collect(),
            depth: raster
                .features
                .iter()
                .zip(&raster.transmittance)
                .map(|(depth, transmittance)| {
                    let opacity = 1.0 - transmittance;
                    if opacity > LEAST_OPACITY {
                        depth / opacity
                    } else {
                        f32::INFINITY
                    }
                })
                .collect(),
        }
    }

    /// Takes a gain out of the image.
    fn normalize(&mut self, exposure: &Exposure, seconds: f64) {
        let gain = exposure.gain(seconds);
        for (shown, difference) in self.shown.iter_mut().zip(&mut self.difference) {
            for channel in 0..3 {
                let normalized = shown[channel] / gain[channel];
                difference[channel] += normalized - shown[channel];
                shown[channel] = normalized;
            }
        }
    }

    /// Means of the pixels within `reach` of a point's image: a pixel alone has the error of every edge
    /// that it lies on. `None` where the point is hidden, or masked.
    fn sample(
        &self,
        scene: &TrainingScene,
        view: &View,
        point: Vec3,
        reach: usize,
    ) -> Option<Sample> {
        let point = view.rotation * (point - view.centre);
        let distance = point.length();
        if distance <= 0.0 {
            return None;
        }
        let pixel = erp::project(&scene.camera, point, distance).pixel;
        let column = (pixel.x as usize).min(self.width - 1);
        let lowest = self.height.saturating_sub(1 + reach).max(reach);
        let row = (pixel.y as usize).clamp(reach, lowest);
        let is_visible = distance <= DEPTH_SLACK * self.depth[row * self.width + column];
        if !is_visible || self.height <= 2 * reach || self.width <= reach {
            return None;
        }
        let (mut shown, mut residual) = ([0.0; 3], [0.0; 3]);
        for row in row - reach..=row + reach {
            for step in self.width - reach..=self.width + reach {
                let pixel = row * self.width + (column + step) % self.width;
                for channel in 0..3 {
                    shown[channel] += self.shown[pixel][channel];
                    residual[channel] += self.difference[pixel][channel];
                }
            }
        }
        let pixels = ((2 * reach + 1) * (2 * reach + 1)) as f32;
        (!residual[0].is_nan()).then(|| Sample {
            shown: shown.map(|sum| sum / pixels),
            residual: residual.map(|sum| sum / pixels),
        })
    }
}

/// Evidence from the residuals of every point.
fn transients(residuals: &[Vec<f32>]) -> MotionEvidence {
    let mut deviations: Vec<f32> = residuals
        .par_iter()
        .flat_map_iter(|residuals| deviations(residuals))
        .collect();
    if deviations.is_empty() {
        return MotionEvidence::default();
    }
    deviations.sort_by(f32::total_cmp);
    let noise = PER_MEDIAN * deviations[deviations.len() / 2];
    let mut evidence = MotionEvidence {
        samples: deviations.len(),
        noise,
        transient_share: 0.0,
    };
    let below = deviations.partition_point(|&deviation| deviation < evidence.limit());
    evidence.transient_share = (deviations.len() - below) as f64 / deviations.len() as f64;
    evidence
}

/// Deviations from a point's median; none where too few views see it.
fn deviations(residuals: &[f32]) -> impl Iterator<Item = f32> {
    let mut sorted = if residuals.len() >= LEAST_VIEWS {
        residuals.to_vec()
    } else {
        Vec::new()
    };
    sorted.sort_by(f32::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or_default();
    sorted
        .into_iter()
        .map(move |residual| (residual - median).abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_in_every_view_is_no_motion() {
        // Every point has an error of its own, and one in twenty something passing for one view.
        let point = |number: usize, passes: bool| -> Vec<f32> {
            let own = 0.3 * ((number % 7) as f32 - 3.0);
            let noise = |view: usize| 0.01 * ((view * 5 + number) % 3) as f32;
            (0..10)
                .map(|view| own + noise(view) + if passes && view == 4 { 0.5 } else { 0.0 })
                .collect()
        };
        let all = |share: usize| -> Vec<Vec<f32>> {
            (0..200)
                .map(|n| point(n, share > 0 && n % share == 0))
                .collect()
        };
        let still = transients(&all(0));
        assert_eq!((still.samples, still.transient_share), (2_000, 0.0));
        assert!(!still.moves() && still.noise < 0.03);
        let moving = transients(&all(20));
        assert!(
            (moving.transient_share - 0.005).abs() < 1e-9 && moving.moves(),
            "{moving:?}"
        );
    }

    #[test]
    fn without_samples_it_may_move() {
        let nothing = transients(&[vec![0.1; 3], vec![0.2; 5]]);
        assert!(nothing.samples == 0 && nothing.moves());
        assert!(nothing.text().contains("no scene point"));
    }
}
