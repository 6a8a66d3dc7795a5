//! Trained model: parts, each a table of Gaussians with the parameterization that activates them, and
//! corrections of poses.
//!
//! * [`exposure`]: gains of the views, in linear light. [`camera_response`]: gains, tone curve and vignette, learnt.
//!   [`pose_corrections`]: of the input views' poses.
//! * [`layers`]: layers for viewing. [`saved`]: a model in a checkpoint.
//! * [`dynamic_settings`]: training settings of dynamic methods.

pub mod camera_response;
pub(crate) mod cpu_renderer;
pub mod dynamic_settings;
pub mod exposure;
pub mod layers;
pub mod pose_corrections;
pub mod saved;

use self::{camera_response::CameraResponse, pose_corrections::PoseCorrections};
use crate::{
    camera::View,
    clock::TimeSpan,
    gaussians::{
        ActivatedGaussians,
        parameterization::{Parameterization, Viewpoint},
        static_gaussians::{self, StaticGaussians},
        temporal::TemporalFeatures,
    },
    parameters::{ArrayShape, ParameterArray, ParameterTable},
    render::Visible,
};

/// Gaussians of one kind.
#[derive(Debug, Clone)]
pub struct Part {
    /// Meaning of their parameters.
    pub parameterization: Box<dyn Parameterization>,
    /// Parameters with their moments.
    pub table: ParameterTable,
    /// Statistics for their density control.
    pub statistics: Statistics,
    /// Optimizer steps of a shard, which is not trained by every view; 0 for other parts.
    pub steps: u64,
}

impl Part {
    /// Creates a part at the start of its training.
    pub fn new(parameterization: impl Parameterization + 'static, table: ParameterTable) -> Self {
        let statistics = Statistics::new(table.len(), parameterization.temporal().is_some());
        Self {
            parameterization: Box::new(parameterization),
            table,
            statistics,
            steps: 0,
        }
    }

    /// Resets the statistics.
    pub fn forget_statistics(&mut self) {
        let with_times = self.parameterization.temporal().is_some();
        self.statistics = Statistics::new(self.table.len(), with_times);
    }

    fn shared_array(&self) -> Option<&ParameterArray> {
        Some(&self.parameterization.shared()?.array)
    }
}

/// Equal if training would continue in the same way.
impl PartialEq for Part {
    fn eq(&self, other: &Self) -> bool {
        self.parameterization.id() == other.parameterization.id()
            && self.parameterization.shared() == other.parameterization.shared()
            && self.table == other.table
            && self.statistics == other.statistics
            && self.steps == other.steps
    }
}

/// Trained model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Model {
    /// Gaussians by kind; an activated model concatenates them in this order.
    pub parts: Vec<Part>,
    /// Response of the camera, if it is learnt.
    pub response: Option<CameraResponse>,
    /// Corrections of the input views' poses, if they are refined.
    pub poses: Option<PoseCorrections>,
    /// The clip that it was trained on, if it is of a run.
    pub clip: Option<TimeSpan>,
}

/// Trained arrays of one name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TrainedArray {
    /// Name, unique in a model.
    pub name: &'static str,
    /// Current number of values.
    pub values: usize,
}

impl Model {
    /// Creates a model of these parts.
    pub fn new(parts: Vec<Part>) -> Self {
        Self {
            parts,
            response: None,
            poses: None,
            clip: None,
        }
    }

    /// Creates a model of static Gaussians.
    pub fn of_static(table: ParameterTable) -> Self {
        Self::new(vec![Part::new(StaticGaussians, table)])
    }

    /// Returns the number of Gaussians.
    pub fn len(&self) -> usize {
        self.parts.iter().map(|part| part.table.len()).sum()
    }

    /// Returns true if there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the number of Gaussians with their own times.
    pub fn len_with_times(&self) -> usize {
        let with_times = |part: &&Part| part.parameterization.temporal().is_some();
        let parts = self.parts.iter().filter(with_times);
        parts.map(|part| part.table.len()).sum()
    }

    /// Returns the number of rigid objects; `None` for a model without tracked objects.
    pub fn objects(&self) -> Option<usize> {
        let tracked = self
            .parts
            .iter()
            .filter_map(|part| part.parameterization.tracked());
        tracked
            .map(|tracked| tracked.objects().len())
            .reduce(|all, more| all + more)
    }

    /// Returns the time in which its Gaussians change, and of its clip; `None` if nothing depends on it. Objects may be
    /// there in a part of the clip alone.
    pub fn time_span(&self) -> Option<TimeSpan> {
        let spans = self
            .parts
            .iter()
            .filter_map(|part| part.parameterization.time_span());
        let own = spans.reduce(TimeSpan::union)?;
        Some(self.clip.map_or(own, |clip| own.union(clip)))
    }

    /// Returns a view with the corrected pose, for training and rendering.
    pub fn corrected(&self, view: &View) -> View {
        match &self.poses {
            Some(poses) => poses.apply(view),
            None => *view,
        }
    }

    /// Iterates over all arrays with rows: tables of the parts, parameters shared by their Gaussians, the
    /// response of the camera, corrections of poses.
    fn arrays(&self) -> impl Iterator<Item = &ParameterArray> {
        let tables = self.parts.iter().flat_map(|part| &part.table.arrays);
        let shared = self.parts.iter().filter_map(Part::shared_array);
        let response = self.response.iter().flat_map(CameraResponse::arrays);
        let poses = self.poses.iter().flat_map(|poses| &poses.table.arrays);
        tables.chain(shared).chain(response).chain(poses)
    }

    /// Returns all arrays that are not frozen by name, in a fixed order; arrays of one name in several parts
    /// are merged.
    pub fn trained_arrays(&self) -> Vec<TrainedArray> {
        let mut trained: Vec<TrainedArray> = Vec::new();
        for array in self.arrays().filter(|array| !array.is_frozen()) {
            match trained.iter_mut().find(|known| known.name == array.name) {
                Some(known) => known.values += array.values.len(),
                None => trained.push(TrainedArray {
                    name: array.name,
                    values: array.values.len(),
                }),
            }
        }
        trained
    }

    /// Returns names and widths of all arrays, in the order of [`Model::trained_arrays`].
    pub fn shapes(&self) -> Vec<ArrayShape> {
        let mut shapes: Vec<ArrayShape> = Vec::new();
        for ParameterArray { name, width, .. } in self.arrays() {
            if shapes.iter().all(|known| known.name != *name) {
                shapes.push(ArrayShape {
                    name,
                    width: *width,
                });
            }
        }
        shapes
    }

    /// Returns the bytes of parameters, gradients and moments.
    pub fn bytes(&self) -> u64 {
        self.arrays().map(ParameterArray::bytes).sum()
    }

    /// Returns a description of the first value that is not finite.
    pub fn not_finite(&self) -> Option<String> {
        self.arrays().find_map(|array| {
            let columns = [&array.values, &array.first_moments, &array.second_moments];
            let bad = |column: &&Vec<f32>| column.iter().position(|value| !value.is_finite());
            let at = columns.iter().find_map(bad)?;
            Some(format!(
                "row {} of {} is not finite",
                at / array.width.max(1),
                array.name
            ))
        })
    }

    /// Activates all Gaussians for a viewpoint, part after part.
    pub fn activate(
        &mut self,
        at: &Viewpoint,
        features: &TemporalFeatures,
        out: &mut ActivatedGaussians,
    ) {
        let degrees = self
            .parts
            .iter()
            .map(|part| static_gaussians::sh_degree(&part.table));
        out.reshape(self.len(), degrees.max().unwrap_or(0), features.count());
        let mut first = 0;
        for part in &mut self.parts {
            part.parameterization
                .activate(&part.table, at, features, first, out);
            first += part.table.len();
        }
    }

    /// Computes the VJP of [`Model::activate`], whose last call had the same arguments: overwrites the
    /// gradients of all tables and shared parameters. `activated` and `gradient` are consumed.
    pub fn activate_backward(
        &mut self,
        at: &Viewpoint,
        features: &TemporalFeatures,
        activated: &mut ActivatedGaussians,
        gradient: &mut ActivatedGaussians,
    ) {
        let mut first = 0;
        for part in &mut self.parts {
            let table = &mut part.table;
            part.parameterization
                .activate_backward(table, at, features, first, activated, gradient);
            first += part.table.len();
        }
    }
}

impl From<ParameterTable> for Model {
    fn from(table: ParameterTable) -> Self {
        Self::of_static(table)
    }
}

/// Image-space gradients since the last densification.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Statistics {
    /// Sum of the lengths of the centre's gradients over the views that saw the Gaussian, in normalized
    /// device coordinates.
    pub sums: Vec<f32>,
    /// Number of views that saw it.
    pub views: Vec<u32>,
    /// Sum of `|dL/dtau|` over these views, for Gaussians with peak times `tau`; otherwise empty.
    pub time_gradients: Vec<f32>,
}

impl Statistics {
    /// Creates zero statistics of `len` Gaussians.
    pub fn new(len: usize, with_times: bool) -> Self {
        Self {
            sums: vec![0.0; len],
            views: vec![0; len],
            time_gradients: vec![0.0; if with_times { len } else { 0 }],
        }
    }

    /// Adds the visible Gaussians of one view; `half_size` is half the image's width and height.
    pub fn add(&mut self, visible: impl Iterator<Item = Visible>, half_size: [f32; 2]) {
        for visible in visible {
            let index = visible.gaussian;
            let [u, v] = visible.centre_gradient;
            self.sums[index] += (u * half_size[0]).hypot(v * half_size[1]);
            self.views[index] += 1;
        }
    }

    pub(crate) fn mean(&self, index: usize) -> f32 {
        self.sums[index] / self.views[index].max(1) as f32
    }
}
