//! What training changes: parts, each a table of Gaussians with the parameterization that activates
//! them, and corrections of poses.
//!
//! * [`exposure`]: gains of the views. [`pose_corrections`]: of the input views' poses.
//! * [`layers`]: a model taken apart for people. [`saved`]: a model in a checkpoint.
//! * [`dynamic_settings`]: what training knows of time.

pub(crate) mod cpu_renderer;
pub mod dynamic_settings;
pub mod exposure;
pub mod layers;
pub mod pose_corrections;
pub mod saved;

use self::pose_corrections::PoseCorrections;
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
    /// What their parameters mean.
    pub parameterization: Box<dyn Parameterization>,
    /// Parameters with their moments.
    pub table: ParameterTable,
    /// What their density control goes by.
    pub statistics: Statistics,
    /// Steps of the optimizer on a shard, which may learn from some views alone; 0 of other parts.
    pub steps: u64,
}

impl Part {
    /// Gaussians at the beginning of their training.
    pub fn new(parameterization: impl Parameterization + 'static, table: ParameterTable) -> Self {
        let statistics = Statistics::new(table.len(), parameterization.temporal().is_some());
        Self {
            parameterization: Box::new(parameterization),
            table,
            statistics,
            steps: 0,
        }
    }

    /// Begins the statistics anew.
    pub fn forget_statistics(&mut self) {
        let with_times = self.parameterization.temporal().is_some();
        self.statistics = Statistics::new(self.table.len(), with_times);
    }

    fn shared_array(&self) -> Option<&ParameterArray> {
        Some(&self.parameterization.shared()?.array)
    }
}

/// Equal where the same would be trained on in the same way.
impl PartialEq for Part {
    fn eq(&self, other: &Self) -> bool {
        self.parameterization.id() == other.parameterization.id()
            && self.parameterization.shared() == other.parameterization.shared()
            && self.table == other.table
            && self.statistics == other.statistics
            && self.steps == other.steps
    }
}

/// What training changes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Model {
    /// Gaussians by kind; in an activated model they follow each other in this order.
    pub parts: Vec<Part>,
    /// Corrections of the input views' poses, where they are refined.
    pub poses: Option<PoseCorrections>,
}

/// Everything of one name that is trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TrainedArray {
    /// Name, unique in a model.
    pub name: &'static str,
    /// How many values there are of it at the moment.
    pub values: usize,
}

impl Model {
    /// A model of these parts.
    pub fn new(parts: Vec<Part>) -> Self {
        Self { parts, poses: None }
    }

    /// A model of static Gaussians.
    pub fn of_static(table: ParameterTable) -> Self {
        Self::new(vec![Part::new(StaticGaussians, table)])
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.parts.iter().map(|part| part.table.len()).sum()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How many of them have times of their own.
    pub fn len_with_times(&self) -> usize {
        let with_times = |part: &&Part| part.parameterization.temporal().is_some();
        let parts = self.parts.iter().filter(with_times);
        parts.map(|part| part.table.len()).sum()
    }

    /// Objects that move as one, where it tells any apart.
    pub fn objects(&self) -> Option<usize> {
        let tracked = self
            .parts
            .iter()
            .filter_map(|part| part.parameterization.tracked());
        tracked
            .map(|tracked| tracked.objects.len())
            .reduce(|all, more| all + more)
    }

    /// The time in which its Gaussians change; `None` where nothing depends on it.
    pub fn time_span(&self) -> Option<TimeSpan> {
        let spans = self
            .parts
            .iter()
            .filter_map(|part| part.parameterization.time_span());
        spans.reduce(TimeSpan::union)
    }

    /// A view of the scene with the pose that it is trained and shown with.
    pub fn corrected(&self, view: &View) -> View {
        match &self.poses {
            Some(poses) => poses.apply(view),
            None => *view,
        }
    }

    /// Every array of a model with the rows that it has: tables of the parts, what their Gaussians
    /// share, corrections of poses.
    fn arrays(&self) -> impl Iterator<Item = &ParameterArray> {
        let tables = self.parts.iter().flat_map(|part| &part.table.arrays);
        let shared = self.parts.iter().filter_map(Part::shared_array);
        let poses = self.poses.iter().flat_map(|poses| &poses.table.arrays);
        tables.chain(shared).chain(poses)
    }

    /// All arrays that are not frozen by name, in a fixed order; arrays of one name in several parts count
    /// together.
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

    /// Names and widths of all arrays, in the order of [`Model::trained_arrays`].
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

    /// Bytes of parameters, gradients and moments.
    pub fn bytes(&self) -> u64 {
        self.arrays().map(ParameterArray::bytes).sum()
    }

    /// The first value that is not finite, described.
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

    /// All Gaussians as they are seen from a viewpoint, part after part.
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

    /// VJP of [`Model::activate`], which was called last with the same arguments: overwrites the gradients
    /// of all tables and of what their Gaussians share. `activated` and `gradient` are used up.
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
    /// Sum over the views that saw the Gaussian of the length of its centre's gradient, in
    /// normalized device coordinates.
    pub sums: Vec<f32>,
    /// How many views saw it.
    pub views: Vec<u32>,
    /// Sum of `|dL/dtau|` over these views, where Gaussians have peak times `tau`; empty elsewhere.
    pub time_gradients: Vec<f32>,
}

impl Statistics {
    /// Nothing seen yet, for `len` Gaussians.
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
