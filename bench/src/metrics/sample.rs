//! All data of one prediction.

use std::{collections::BTreeMap, sync::OnceLock};

use omnilife_schemas::rgb::Mask;

use super::{
    ViewPair,
    cube_faces::{self, Face},
    lpips,
    ssim_map::SsimMap,
};

/// Predicted and true distance along the ray, in units of the world frame.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthPair {
    /// One value per pixel, row-major; 0 without depth.
    pub prediction: Vec<f32>,
    /// One value per pixel, row-major; 0 if unknown.
    pub truth: Vec<f32>,
}

/// Input of a metric: a prediction beside its ground truth, with all other data of it. Shared intermediate results
/// are computed once.
///
/// Masks and depth have the size of the images.
#[derive(Debug)]
pub struct Sample<'a> {
    /// The view.
    pub pair: &'a ViewPair,
    /// The view of the same kind before it in time.
    pub previous: Option<&'a ViewPair>,
    /// Marks moving content.
    pub dynamic: Option<&'a Mask>,
    /// Marks the objects of a class, by its name.
    pub classes: BTreeMap<&'a str, &'a Mask>,
    /// Marks single objects, by the object's name.
    pub objects: BTreeMap<&'a str, &'a Mask>,
    /// Depth.
    pub depth: Option<&'a DepthPair>,
    /// True if the left and the right edge of the images meet.
    pub is_panorama: bool,
    ssim_map: OnceLock<SsimMap>,
    cube_faces: OnceLock<Vec<Face>>,
    temporal_lpips: OnceLock<Result<TemporalLpips, Undefined>>,
}

/// Perceptual distances of a view to the one before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TemporalLpips {
    pub(super) prediction: f64,
    pub(super) truth: f64,
}

/// Reason why a metric has no value for a view. Neither 0 nor infinity would be true, so the view does not count in its
/// mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Undefined(pub &'static str);

impl<'a> Sample<'a> {
    /// Creates a view without further data.
    pub fn new(pair: &'a ViewPair) -> Self {
        Self {
            pair,
            previous: None,
            dynamic: None,
            classes: BTreeMap::new(),
            objects: BTreeMap::new(),
            depth: None,
            is_panorama: false,
            ssim_map: OnceLock::new(),
            cube_faces: OnceLock::new(),
            temporal_lpips: OnceLock::new(),
        }
    }

    /// Returns the mask of moving content.
    pub(super) fn dynamic(&self) -> Result<&'a Mask, Undefined> {
        self.dynamic.ok_or(Undefined("the frame has no mask"))
    }

    pub(super) fn class(&self, name: &str) -> Result<&'a Mask, Undefined> {
        let mask = self.classes.get(name).copied();
        mask.ok_or(Undefined("the frame has no mask of the class"))
    }

    pub(super) fn depth(&self) -> Result<&'a DepthPair, Undefined> {
        self.depth.ok_or(Undefined("the frame has no depth"))
    }

    /// Returns the SSIM of every pixel.
    pub(super) fn ssim_map(&self) -> &SsimMap {
        self.ssim_map.get_or_init(|| {
            let [prediction, truth] = self.pair.unit_values();
            SsimMap::new(self.pair.size(), [&prediction, &truth], self.pair.counted())
        })
    }

    /// Returns the six faces of the cube around the camera.
    pub(super) fn cube_faces(&self) -> &[Face] {
        self.cube_faces
            .get_or_init(|| cube_faces::render(self.pair))
    }

    /// Returns the LPIPS from the view before it.
    pub(super) fn temporal_lpips(&self) -> Result<TemporalLpips, Undefined> {
        *self.temporal_lpips.get_or_init(|| {
            let before = self
                .previous
                .ok_or(Undefined("no scored view comes before it"))?;
            let (before, now) = (lpips::features(before)?, lpips::features(self.pair)?);
            Ok(TemporalLpips {
                prediction: lpips::of_features([&before.prediction, &now.prediction])?,
                truth: lpips::of_features([&before.truth, &now.truth])?,
            })
        })
    }
}
