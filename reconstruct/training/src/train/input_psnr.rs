//! PSNR of input views during training, by region: the whole view, the static region and the dynamic region.
//!
//! It is measured at the rows of the trace, on a few of the views with a dynamic mask; it counts as evaluation.
//! It is not a score: scores are the benchmark's metrics, on the written views.

use omnilife_engine::training_view::TrainingView;
use omnilife_schemas::RgbImage;
use serde::{Deserialize, Serialize};

use super::trace_views::spread;
use crate::{error::ReconstructError, learner::Learner, scene::TrainingScene};

/// Maximum number of examined input views; evenly spread.
const MOST_VIEWS: usize = 4;
/// Minimum share of a dynamic pixel, of 255.
const DYNAMIC: u8 = 128;
/// Minimum mean squared error: 80 dB.
const LEAST_ERROR: f64 = 1e-8;

/// Mean PSNR over some input views, dB; `None` if no view shows the region.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct InputPsnr {
    /// All counted pixels.
    pub whole_db: Option<f64>,
    /// Static region.
    pub static_db: Option<f64>,
    /// Dynamic region.
    pub dynamic_db: Option<f64>,
}

impl InputPsnr {
    /// Measures the current model; `None` if no input view has a dynamic mask.
    pub(super) fn of(
        scene: &TrainingScene,
        learner: &mut dyn Learner,
    ) -> Result<Option<Self>, ReconstructError> {
        let masked: Vec<&TrainingView> = scene
            .input_views
            .iter()
            .filter(|view| view.mask.is_some())
            .collect();
        let mut views = Vec::new();
        for view in spread(&masked, MOST_VIEWS) {
            views.push(of_view(view, &learner.image(&view.view)?));
        }
        let mean = |region: usize| {
            let known: Vec<f64> = views.iter().filter_map(|view| view[region]).collect();
            (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
        };
        let [whole_db, static_db, dynamic_db] = [0, 1, 2].map(mean);
        Ok((!views.is_empty()).then_some(Self {
            whole_db,
            static_db,
            dynamic_db,
        }))
    }
}

/// Returns the PSNR of a view as a whole, in its static and in its dynamic region; `None` for a region without
/// pixels.
fn of_view(view: &TrainingView, rendered: &RgbImage) -> [Option<f64>; 3] {
    let (mut errors, mut counts) = ([0.0; 3], [0_u64; 3]);
    let given = view.pixels.as_chunks::<3>().0.iter();
    let pixels = given.zip(rendered.data.as_chunks::<3>().0).enumerate();
    for (pixel, (given, rendered)) in pixels.filter(|(pixel, _)| view.shows_scene(*pixel)) {
        let difference = |(given, rendered): (&u8, &f32)| {
            let rendered = f64::from(rendered.clamp(0.0, 1.0));
            (f64::from(*given) / 255.0 - rendered).powi(2)
        };
        let error: f64 = given.iter().zip(rendered).map(difference).sum();
        let moves = view
            .mask
            .as_ref()
            .is_some_and(|mask| mask[pixel] >= DYNAMIC);
        for region in [0, 1 + usize::from(moves)] {
            errors[region] += error;
            counts[region] += 3;
        }
    }
    [0, 1, 2].map(|region| {
        let mean = errors[region] / counts[region] as f64;
        (counts[region] > 0).then(|| -10.0 * mean.max(LEAST_ERROR).log10())
    })
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};
    use omnilife_engine::camera::View;
    use omnilife_schemas::{Pose, Similarity, camera::ErpCamera};

    use super::*;

    #[test]
    fn regions_are_told_apart_and_what_is_ignored_counts_in_none() {
        let camera = ErpCamera::new(4, 2);
        let pose = Pose::new(DQuat::IDENTITY, DVec3::ZERO);
        let as_is = Similarity::new([0.0; 3], 1.0);
        let mut view = TrainingView {
            frame: 0,
            view: View::new(camera, &pose, &as_is, 0.0).expect("a pose"),
            pixels: vec![51; 24],
            mask: Some(vec![255, 200, 100, 0, 0, 0, 0, 0]),
            ignored: Some(vec![0, 0, 0, 0, 0, 0, 0, 1]),
        };
        let mut rendered = RgbImage::from_rgb8(4, 2, &[51; 24]);
        // Errors of 0.1 in the dynamic region, of 0.01 in the static region, and large ones in ignored pixels.
        for (pixel, colour) in rendered.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let error = match pixel {
                0 | 1 => 0.1,
                7 => 0.7,
                _ => 0.01,
            };
            *colour = [0.2 + error; 3];
        }
        let near = |found: Option<f64>, expected: f64| {
            found.is_some_and(|found| (found - expected).abs() < 1e-4)
        };
        let [whole, still, moving] = of_view(&view, &rendered);
        assert!(
            near(moving, 20.0) && near(still, 40.0),
            "{moving:?} {still:?}"
        );
        let mean: f64 = (2.0 * 0.01 + 5.0 * 0.0001) / 7.0;
        assert!(near(whole, -10.0 * mean.log10()), "{whole:?}");
        view.mask = Some(vec![0; 8]);
        assert_eq!(of_view(&view, &rendered)[2], None);
    }
}
