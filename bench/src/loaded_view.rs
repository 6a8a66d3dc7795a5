//! Data of one view, each file read once.

use std::collections::BTreeMap;

use omnilife_schemas::{
    camera::Camera,
    object_regions::Region,
    rgb::{self, Mask},
};

use crate::{
    error::BenchError,
    job::{ScoringJob, View},
    lpips::Backbone,
    metrics::{DepthPair, Need, Sample, ViewPair},
    prediction::PredictionFolder,
    truth,
};

/// A view with the data that its metrics need.
pub(crate) struct LoadedView {
    pub(crate) view: View,
    /// Name of the prediction's file.
    pub(crate) name: String,
    /// Prediction and ground truth, or the reason why the prediction cannot be scored.
    pub(crate) pair: Result<ViewPair, String>,
    /// True if a mask marks any of its pixels as outside the scene.
    pub(crate) ignores_pixels: bool,
    /// True if its ground truth shows nothing.
    pub(crate) is_truth_single_colour: bool,
    dynamic: Option<Mask>,
    classes: BTreeMap<&'static str, Mask>,
    objects: BTreeMap<String, Mask>,
    depth: Option<DepthPair>,
    is_panorama: bool,
}

impl LoadedView {
    /// Reads a view.
    ///
    /// # Errors
    /// When the scene's files are unusable; an unusable prediction is a fact about the view.
    pub(crate) fn read(job: &ScoringJob, view: View) -> Result<Self, BenchError> {
        let truth = truth::read(job, view.frame)?;
        let ignored = truth::read_ignore_mask(job, view.frame)?;
        let frame = &job.scene.frames[view.frame as usize];
        let dynamic = truth::read_dynamic_mask(job, view.frame)?;
        let mut classes = BTreeMap::new();
        for class in job.classes() {
            if let Some(mask) = truth::read_region(job, frame, Region::Class(class))? {
                classes.insert(class, mask);
            }
        }
        let objects = match job.needs(Need::ObjectMasks) {
            true => truth::read_objects(job, frame)?,
            false => BTreeMap::new(),
        };
        let true_depth = match &frame.depth {
            Some(depth)
                if job.needs(Need::Depth)
                    && job
                        .folder(view.kind)
                        .is_some_and(PredictionFolder::has_depth) =>
            {
                Some(truth::read_depth(job, depth)?)
            }
            _ => None,
        };
        let mut loaded = Self {
            view,
            name: (job.folder(view.kind))
                .map_or_else(String::new, |folder| folder.name(view.frame)),
            pair: Err(String::new()),
            ignores_pixels: ignored.as_ref().is_some_and(Mask::marks_anything),
            is_truth_single_colour: rgb::is_single_colour(&truth),
            dynamic,
            classes,
            objects,
            is_panorama: matches!(job.scene.camera, Camera::Erp(_)),
            depth: None,
        };
        loaded.pair = loaded.read_prediction(job, (truth, ignored.as_ref()), true_depth);
        // Before the view after this one needs them as well.
        if let Ok(pair) = &loaded.pair
            && job.needs(Need::Network(Backbone::Alex))
        {
            pair.alex_features();
        }
        Ok(loaded)
    }

    fn read_prediction(
        &mut self,
        job: &ScoringJob,
        (truth, ignored): (Vec<u8>, Option<&Mask>),
        true_depth: Option<Vec<f32>>,
    ) -> Result<ViewPair, String> {
        let [width, height] = job.size;
        let folder = job
            .folder(self.view.kind)
            .ok_or_else(|| "no predictions given".to_owned())?;
        let prediction = folder.read(self.view.frame, width, height)?;
        if let Some(truth) = true_depth {
            let prediction = folder.read_depth(self.view.frame, width, height)?;
            self.depth = Some(DepthPair { prediction, truth });
        }
        truth::pair(job, prediction, truth, ignored)
            .ok_or_else(|| "images differ in size".to_owned())
    }

    /// Returns the input of metrics; `previous` is the view scored before it.
    pub(crate) fn sample<'a>(
        &'a self,
        pair: &'a ViewPair,
        previous: Option<&'a Self>,
    ) -> Sample<'a> {
        let mut sample = Sample::new(pair);
        sample.previous = previous
            .filter(|previous| previous.view.kind == self.view.kind)
            .and_then(|previous| previous.pair.as_ref().ok());
        sample.dynamic = self.dynamic.as_ref();
        sample.classes = self
            .classes
            .iter()
            .map(|(name, mask)| (*name, mask))
            .collect();
        let objects = self.objects.iter();
        sample.objects = objects.map(|(name, mask)| (name.as_str(), mask)).collect();
        sample.depth = self.depth.as_ref();
        sample.is_panorama = self.is_panorama;
        sample
    }

    /// Returns the scores of the objects in the view by their names: one value per metric of
    /// [`ScoringJob::of_objects`].
    pub(crate) fn of_objects(
        &self,
        job: &ScoringJob,
        pair: &ViewPair,
    ) -> BTreeMap<String, Vec<Option<f64>>> {
        let scores = |(name, mask): (&String, &Mask)| {
            let mut sample = Sample::new(pair);
            sample.objects = [(name.as_str(), mask)].into();
            sample.is_panorama = self.is_panorama;
            let metrics = job.of_objects();
            let scores = metrics.map(|metric| (metric.function)(&sample).ok());
            (name.clone(), scores.collect::<Vec<_>>())
        };
        self.objects.iter().map(scores).collect()
    }
}
