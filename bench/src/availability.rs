//! Availability of metrics for a scene and its predictions.

use omnilife_networks::WeightsError;
use omnilife_schemas::{
    camera::Camera,
    object_regions::Region,
    records::{Scene, SceneFrame, Split},
};

use crate::{
    error::BenchError,
    lpips::Lpips,
    metrics::{Metric, Need},
};

/// Returns why a metric has a value for no view; `None` if no such reason is known beforehand. The reason names no
/// paths of this machine, so that results are the same everywhere.
///
/// # Errors
/// When weights exist but are unusable.
pub(crate) fn why_not(
    metric: &Metric,
    scene: &Scene,
    split: &Split,
    has_tracks: bool,
    depth_is_predicted: bool,
) -> Result<Option<String>, BenchError> {
    let any_frame = |has: &dyn Fn(&SceneFrame) -> bool| {
        let mut frames = split.input_views.iter().chain(&split.novel_views);
        frames.any(|&frame| has(&scene.frames[frame as usize]))
    };
    let tells = |region: Region<'_>| any_frame(&|frame| region.source(scene, frame).is_some());
    for need in metric.needs {
        let reason = match need {
            Need::Network(backbone) => match Lpips::published(*backbone) {
                Ok(_) => continue,
                Err(WeightsError::Unavailable { name, .. }) => format!(
                    "the weights of {name} are not there; scripts/setup --models fetches them"
                ),
                Err(error) => return Err(error.into()),
            },
            Need::Sphere => match scene.camera {
                Camera::Erp(_) => continue,
                Camera::Pinhole(_) => {
                    "it is of whole spheres, and the camera of the scene is a pinhole".to_owned()
                }
            },
            Need::DynamicMask if tells(Region::Moving) => continue,
            Need::DynamicMask if has_tracks => continue,
            Need::DynamicMask => "the scene has no dynamic masks".to_owned(),
            Need::ClassMask(class) if tells(Region::Class(class)) => continue,
            Need::ClassMask(class) => format!("the scene has no masks of class {class}"),
            Need::ObjectMasks if any_frame(&|frame| frame.object_names().next().is_some()) => {
                continue;
            }
            Need::ObjectMasks => "the scene has no masks of single objects".to_owned(),
            Need::Depth if !any_frame(&|frame| frame.depth.is_some()) => {
                "the depth of the scene is not known".to_owned()
            }
            Need::Depth if !depth_is_predicted => {
                "no depth was predicted: the predictions have no folder depth/".to_owned()
            }
            // Depends on the single view: the first one has none before it.
            Need::Depth | Need::PreviousView => continue,
        };
        return Ok(Some(reason));
    }
    Ok(None)
}
